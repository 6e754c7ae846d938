"""`doctor`: whether a measurement would work on this device now, and the obstacles."""

import platform
import sys
from collections.abc import Iterator
from pathlib import Path

from client_kit.device import description, preflight
from client_kit.errors import CannotMeasureError
from client_kit.home import Home
from groundwork import __version__


def examine(home: Home, root: Path = Path("/")) -> Iterator[str]:
    """Yield lines; raises CannotMeasureError at the end where nothing can be measured."""
    yield f"Client {__version__}, Python {platform.python_version()} on {sys.platform}"
    yield f"State is kept in {home.path}"
    from client_kit.device import selection
    from slam.devices.choice import NAMES

    best = selection.choose(root=root)
    present = selection.present()
    names = [(each.backend, each.label) for each in present]
    chosen = names.index((best.backend, best.label))  # of two identical devices, the first
    for number, device in enumerate(present):
        used = ", used unless --device or --backend names another" if number == chosen else ""
        memory = f", {device.global_memory >> 20} MiB" if device.global_memory else ""
        yield f"{NAMES[device.backend]} device: {device.label}{memory}{used}"
    yield "What this device would send to the server:"
    identity = description.identify(root, processor=description.processor_identity(best))
    for name, value in identity.items():
        yield f"  {name}: {'unknown' if value is None else value}"
    for reason in preflight.too_large({"": {"volume_resolution": 512}}, best, root).values():
        yield f"Note: {reason}; such configurations are recorded as failed"
    concerns = preflight.concerns(home, root)
    for concern in concerns:
        yield f"{'Stop' if concern.stops else 'Note'}: {concern.text}"
    stopping = [concern for concern in concerns if concern.stops]
    if stopping:
        raise CannotMeasureError(stopping[0].text)
    yield "This device can measure now."
