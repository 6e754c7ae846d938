"""Whose chip computed: the families that people know graphics chips by."""

from functools import lru_cache

from crowd.devices import chips
from crowd.devices.naming import processors

CPU = "CPU"
OTHER = "other"

# Each family with its maker; in the order in which people are offered them.
VENDORS = {
    "Adreno": "Qualcomm Adreno",
    "Mali": "Arm Mali",
    "PowerVR": "Imagination PowerVR",
    "Xclipse": "Samsung Xclipse",
    "Apple": "Apple",
    "NVIDIA": "NVIDIA",
    "Radeon": "AMD Radeon",
    "Intel": "Intel",
    CPU: "CPU (PoCL and the like)",
    OTHER: "other",
}


@lru_cache(maxsize=10_000)
def vendor(processor: str, gpu: str = "", kind: str = "") -> str:
    """The family of a processor's or an OpenCL device's name, or of the device model's GPU where PROCESSOR
    names no chip. OTHER if unknown, CPU where KIND is "cpu". One of VENDORS.
    """
    if kind == processors.CPU:
        return CPU
    for text in (processor, gpu):
        chip = chips.graphics(text)
        if chip is not None:
            return chip.family if chip.family in VENDORS else OTHER
        if chips.processor(text) or processors.CPU_DEVICE.search(text):
            return CPU
    return OTHER


def known(text: str) -> str | None:
    """The one of VENDORS that a person means by TEXT: by its name, its maker's or both. None if
    there is none."""
    wanted = text.casefold()
    for name, full in VENDORS.items():
        if wanted in {name.casefold(), full.casefold(), full.casefold().removesuffix(f" {name}".casefold())}:
            return name
    return None
