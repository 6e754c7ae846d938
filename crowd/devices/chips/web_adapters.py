"""WebGPU adapters. Browsers report the maker and architecture of a graphics chip, rarely the chip itself.

The words are those of Dawn (Chrome, Edge) and WebKit. Other words never become part of a name.
"""

from dataclasses import dataclass

from crowd.devices.chips.graphics_chips import graphics

OTHER = "other"
# By maker: the name for an unknown architecture, and the name for each architecture.
HARDWARE: dict[str, tuple[str, dict[str, str]]] = {
    "amd": (
        "AMD Radeon Graphics",
        {f"{series}-{number}": f"AMD {series.upper()} {number}"
         for series in ("gcn", "rdna", "cdna") for number in range(1, 6)},
    ),
    "apple": (
        "Apple GPU",
        {f"{family}-{number}": "Apple GPU"
         for family in ("metal", "apple", "common") for number in range(1, 11)},
    ),
    "arm": (
        "Mali",
        {
            "midgard": "Mali (Midgard)", "bifrost": "Mali (Bifrost)", "valhall": "Mali (Valhall)",
            "gen-5": "Mali (5th Gen)",
        },
    ),
    "broadcom": ("Broadcom VideoCore", {"videocore": "Broadcom VideoCore"}),
    "huawei": ("HiSilicon Maleoon", {}),
    "img-tec": (
        "PowerVR",
        {
            "rogue": "PowerVR (Rogue)", "furian": "PowerVR (Furian)", "albiorix": "PowerVR (Albiorix)",
        },
    ),
    "intel": (
        "Intel Graphics",
        {
            "gen-7": "Intel Graphics (Gen 7)", "gen-8": "Intel Graphics (Gen 8)",
            "gen-9": "Intel Graphics (Gen 9)", "gen-11": "Intel Graphics (Gen 11)",
            "gen-12lp": "Intel Graphics (Gen 12 LP)", "gen-12hp": "Intel Graphics (Gen 12 HP)",
            "xe-lpg": "Intel Graphics (Xe LPG)", "xe-2lpg": "Intel Graphics (Xe2 LPG)",
            "xe-2hpg": "Intel Graphics (Xe2 HPG)", "xe-3lpg": "Intel Graphics (Xe3 LPG)",
        },
    ),
    "nvidia": (
        "NVIDIA GPU",
        {name.casefold(): f"NVIDIA {name}" for name in (
            "Fermi", "Kepler", "Maxwell", "Pascal", "Volta", "Turing", "Ampere", "Lovelace", "Hopper",
            "Blackwell",
        )},
    ),
    "qualcomm": ("Adreno", {f"adreno-{number}xx": f"Adreno {number}xx" for number in range(3, 10)}),
    "samsung": ("Samsung Xclipse", {f"rdna-{n}": f"Samsung Xclipse (RDNA {n})" for n in range(2, 5)}),
}  # fmt: skip
# Software renderers by maker and architecture.
SOFTWARE = {
    ("google", "swiftshader"): "SwiftShader",
    ("mesa", "software"): "llvmpipe",
    ("microsoft", "warp"): "Microsoft WARP",
}
# Software renderers in an adapter's description.
DESCRIBED = {
    "swiftshader": "SwiftShader",
    "llvmpipe": "llvmpipe",
    "lavapipe": "llvmpipe",
    "microsoft basic render": "Microsoft WARP",
}
# Names that stand for several chips: two devices with such a name may have different chips.
FAMILIES = frozenset(
    name for maker, architectures in HARDWARE.values() for name in (maker, *architectures.values())
)


@dataclass(frozen=True)
class Adapter:
    """The chip, or family of chips, behind a WebGPU adapter. `software`: a renderer on the processor.

    `name` is empty if no rule matches.
    """

    name: str
    software: bool


def adapter(vendor: str, architecture: str, described: tuple[str, ...], fallback: bool = False) -> Adapter:
    """The adapter for `vendor` and `architecture`.

    A chip named in `described` takes precedence. Software renderers and `fallback` adapters are always
    software.
    """
    vendor, architecture = vendor.casefold(), architecture.casefold()
    texts = " ".join((vendor, *described)).casefold()
    renderer = SOFTWARE.get((vendor, architecture)) or next(
        (name for words, name in DESCRIBED.items() if words in texts), ""
    )
    if renderer or fallback:
        return Adapter(renderer, software=True)
    named = [match.name for text in described if (match := graphics(text))]
    chip = next((name for name in named if is_one_chip(name)), "")
    maker, architectures = HARDWARE.get(vendor, ("", {}))
    family = architectures.get(architecture, maker)
    return Adapter(chip or family or next(iter(named), ""), software=False)


def is_one_chip(name: str) -> bool:
    """Whether `name` is one chip, not a family of chips such as "Adreno"."""
    return name not in FAMILIES and any(letter.isdigit() for letter in name)


def listed_words(vendor: str, architecture: str) -> tuple[str, str]:
    """`vendor` and `architecture`, with OTHER in place of words that are not listed.

    Empty texts stay empty.
    """
    vendor, architecture = vendor.casefold(), architecture.casefold()
    if not vendor:
        return "", OTHER if architecture else ""
    if (vendor, architecture) in SOFTWARE:
        return vendor, architecture
    listed = vendor in HARDWARE or any(vendor == maker for maker, _ in SOFTWARE)
    if not listed:
        return OTHER, OTHER if architecture else ""
    _, architectures = HARDWARE.get(vendor, ("", {}))
    return vendor, architecture if not architecture or architecture in architectures else OTHER
