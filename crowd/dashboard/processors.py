"""Families of processors, told from the names that OpenCL drivers give: how charts colour devices."""

import re

CPU = "CPU"
OTHER = "other"

# First match wins. A CPU behind PoCL names its vendor too, so it comes before the GPU vendors.
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


def family(processor: str, gpu: str = "") -> str:
    """The family of an OpenCL device's name, or of the device model's GPU where the name says nothing;
    OTHER if unknown.
    """
    for text in (processor, gpu):
        for name, pattern in _FAMILIES:
            if re.search(pattern, text, re.IGNORECASE):
                return name
    return OTHER
