"""What the parameters of the systems mean."""

from slam.definitions import SYSTEMS


def meaning_of(name: str) -> str:
    """What the parameter `name` means, with its unit; "" where no system has it."""
    systems = (system.parameters for system in SYSTEMS.values())
    return str(next((parameters[name] for parameters in systems if name in parameters), ""))
