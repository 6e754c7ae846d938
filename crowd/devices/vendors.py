"""Whose chip computed: the families that people know graphics chips by, told from the names drivers give."""

import re
from functools import lru_cache

CPU = "CPU"
OTHER = "other"

# First match wins. A processor behind PoCL names its maker too, so it comes before the GPUs' makers.
_FAMILIES = (
    (CPU, r"pthread|\bcpu\b|xeon|epyc|ryzen|threadripper|\bcore\(tm\) i\d|cortex-|neoverse|llvmpipe"),
    ("Mali", r"mali|immortalis"),
    ("Adreno", r"adreno|qualcomm"),
    ("PowerVR", r"powervr|rogue|imagination"),
    ("Xclipse", r"xclipse"),
    ("Apple", r"\bapple\b"),
    ("NVIDIA", r"nvidia|geforce|quadro|tesla|tegra|\b[rg]tx\b"),
    ("Radeon", r"radeon|\bamd\b|\bgfx\d+"),
    ("Intel", r"intel.*(graphics|arc|iris|xe)|\bu?hd graphics\b"),
)
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
def vendor(processor: str, gpu: str = "") -> str:
    """The family of an OpenCL device's name, or of the device model's GPU where the name says nothing;
    OTHER if unknown. One of VENDORS.
    """
    for text in (processor, gpu):
        for name, pattern in _FAMILIES:
            if re.search(pattern, text, re.IGNORECASE):
                return name
    return OTHER


def known(text: str) -> str | None:
    """The one of VENDORS that a person means by TEXT: its name, its maker's or both; None for no such."""
    wanted = text.casefold()
    for name, full in VENDORS.items():
        if wanted in {name.casefold(), full.casefold(), full.casefold().removesuffix(f" {name}".casefold())}:
            return name
    return None
