"""Families of graphics chips, by maker."""

from functools import lru_cache

from crowd.devices import chips
from crowd.devices.naming import processors

CPU = "CPU"
OTHER = "other"

# Each family with its full name, in the order of the filter.
VENDORS = {
    "Adreno": "Qualcomm Adreno",
    "Mali": "Arm Mali",
    "PowerVR": "Imagination PowerVR",
    "Xclipse": "Samsung Xclipse",
    "Apple": "Apple",
    "NVIDIA": "NVIDIA",
    "Radeon": "AMD Radeon",
    "Intel": "Intel",
    CPU: "CPU (PoCL, WebAssembly and the like)",
    OTHER: "other",
}


@lru_cache(maxsize=10_000)
def vendor(processor: str, gpu: str = "", kind: str = "") -> str:
    """The family of `processor`, or of GPU if `processor` does not name a chip. One of VENDORS.

    CPU if `kind` is "cpu"; OTHER if unknown.
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


def find(text: str) -> str | None:
    """The family that `text` names by family, maker or both; None if there is none."""
    wanted = text.casefold()
    for name, full in VENDORS.items():
        if wanted in {name.casefold(), full.casefold(), full.casefold().removesuffix(f" {name}".casefold())}:
            return name
    return None
