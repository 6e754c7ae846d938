"""Well-known names of chips: processors, graphics chips, systems on a chip, WebGPU adapters.

Drivers, kernels and catalogues spell one chip in many ways ("QTI SM8550", "kalama"; "Qualcomm Adreno (TM)
506", "QUALCOMM Adreno(TM) 506"). Tables map them to one name. Other text never becomes part of a name: names
are public, and anyone can send any text.
"""

import re
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

from crowd.devices.naming.rules import Rules, numbered, one_of, table

CPU: Literal["cpu"] = "cpu"
GPU: Literal["gpu"] = "gpu"
OTHER = "other"

PROCESSOR_NOISE = re.compile(
    r"\((?:r|tm|c)\)|[®™]|\b(?:cpu|processor)\b|@.*$|\b\d+(?:\.\d+)?\s*[mg]hz\b|"
    r"\b(?:\d+|dual|triple|quad|six|eight|ten|twelve|sixteen)[- ]core\b|\bw(?:ith\b|/).*$",
    re.IGNORECASE,
)
PROCESSORS = Rules({pattern: name for rows in table("processors").values() for pattern, name in rows.items()})

_graphics = table("graphics_chips")
GRAPHICS_NOISE = re.compile(
    r"\((?:r|tm|c|rev \w+|\d+ mhz)\)|[®™]|_|^\d+x |\[0x[0-9a-f]+\]|\bcorporation\b|"
    r"\bimagination tech(?:nologies)?\b",
    re.IGNORECASE,
)
NOT_GRAPHICS = one_of(_graphics["not_chips"])
FAMILIES_OF_GRAPHICS = {
    family: Rules({pattern.replace("<suffix>", _graphics["suffix"]): name for pattern, name in rows.items()})
    for family, rows in _graphics["families"].items()
}
# Devices that are processors on any platform: PoCL's, and software renderers.
CPU_DEVICE = re.compile(r"^(pthread|basic)\b|\bcpu\b|\bkvm processor\b", re.IGNORECASE)
RENDERER = re.compile(
    r"llvmpipe|lavapipe|softpipe|swiftshader|microsoft basic render|software (rasterizer|adapter)",
    re.IGNORECASE,
)

_socs = table("systems_on_chip")
BOARDS: dict[str, str] = _socs["boards"]
MARKET_NAMES: dict[str, str] = _socs["market_names"]
SYSTEMS_ON_CHIP = Rules(_socs["names"])
# A chip has the same name whether its code or its market name is given.
CODES = {
    f"{'Samsung' if code.startswith('S5E') else 'Qualcomm'} {market}": code
    for code, market in MARKET_NAMES.items()
}
MARKED = re.compile(r"\((?:r|tm)\)|[®™]", re.IGNORECASE)
CODE = re.compile(r"^(?:Qualcomm|Samsung) ([A-Z]+\d[\dXE]\d*)")

# Browsers report the maker and architecture of a graphics chip, rarely the chip itself.
_adapters = table("web_adapters")
HARDWARE = {maker: dict(numbered(rows)) for maker, rows in _adapters["hardware"].items()}
SOFTWARE: dict[str, dict[str, str]] = _adapters["software"]
# Names that stand for several chips: two devices with such a name may have different chips.
FAMILIES = frozenset(name for rows in HARDWARE.values() for name in rows.values())

CPU_VENDOR = "CPU"
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
    CPU_VENDOR: "CPU (PoCL, WebAssembly and the like)",
    OTHER: "other",
}


@dataclass(frozen=True)
class Processor:
    """A chip that computes. Its `name` comes from a table; it may be a family of chips."""

    name: str
    kind: Literal["cpu", "gpu"]


@dataclass(frozen=True)
class Graphics:
    """A graphics chip: its driver family and its name.

    If only the family is known, the name is that of the family: "Adreno", "NVIDIA GPU".
    """

    family: str
    name: str


def processor(line: str) -> str:
    """The maker and model of the processor that `line` names; empty if no rule matches.

    `line` may also be the name of an OpenCL device on a processor: "cpu-znver4-AMD EPYC 9654".
    """
    return PROCESSORS.name(without_noise(line))


def without_noise(line: str) -> str:
    """`line` without trade marks, clock rates and core counts: the same for all devices with one
    processor."""
    return " ".join(PROCESSOR_NOISE.sub(" ", line).split())


def graphics(line: str) -> Graphics | None:
    """The graphics chip that `line` of a driver or a catalogue names.

    None if no rule matches, and for software renderers.
    """
    clean = " ".join(GRAPHICS_NOISE.sub(" ", line).split())
    clean = re.sub(r"(\d) gb\b", r"\1GB", clean, flags=re.IGNORECASE)
    if NOT_GRAPHICS.search(clean):
        return None
    named = ((family, rules.name(clean)) for family, rules in FAMILIES_OF_GRAPHICS.items())
    return next((Graphics(family, name) for family, name in named if name), None)


def system_on_chip(*texts: str) -> str:
    """The system on a chip that `texts` name: maker, market name and code. The first known text counts.

    "QTI SM8550", "kalama" and "SM8550" all are "Qualcomm Snapdragon 8 Gen 2 (SM8550)". Empty if no rule
    matches.
    """
    return next((name for line in texts if (name := _system_on_chip(line))), "")


def _system_on_chip(line: str) -> str:
    clean = " ".join(MARKED.sub(" ", BOARDS.get(line.casefold(), line)).split())
    if re.match(r"(?:intel|amd)\b", clean, re.IGNORECASE):
        return processor(clean)
    name = SYSTEMS_ON_CHIP.name(clean)
    if name in CODES:
        return f"{name} ({CODES[name]})"
    if match := CODE.match(name):
        # Trailing letters are a revision (MSM8974AC), which is sold under the same name.
        maker, code = name.split()[:2]
        market = MARKET_NAMES.get(code) or MARKET_NAMES.get(match[1])
        return f"{maker} {market} ({code})" if market else name
    return name


def adapter(vendor: str, architecture: str, described: tuple[str, ...], fallback: bool = False) -> Processor:
    """What computes for a WebGPU adapter. The name is empty if no rule matches.

    A chip named in `described` takes precedence. Software renderers and `fallback` adapters are processors.
    """
    vendor, architecture = vendor.casefold(), architecture.casefold()
    texts = " ".join((vendor, *described)).casefold()
    renderer = SOFTWARE.get(vendor, {}).get(architecture) or next(
        (name for words, name in _adapters["described"].items() if words in texts), ""
    )
    if renderer or fallback:
        return Processor(renderer, CPU)
    named = [match.name for text in described if (match := graphics(text))]
    chip = next((name for name in named if is_one_chip(name)), "")
    rows = HARDWARE.get(vendor, {})
    family = rows.get(architecture) or rows.get("", "")
    return Processor(chip or family or next(iter(named), ""), GPU)


def is_one_chip(name: str) -> bool:
    """Whether `name` is one chip, not a family of chips such as "Adreno"."""
    return name not in FAMILIES and any(letter.isdigit() for letter in name)


def listed_words(vendor: str, architecture: str) -> tuple[str, str]:
    """`vendor` and `architecture`, with OTHER in place of words that are not listed.

    Empty texts stay empty.
    """
    vendor, architecture = vendor.casefold(), architecture.casefold()
    rows = HARDWARE.get(vendor) or SOFTWARE.get(vendor, {})
    listed = not architecture or architecture in rows
    return vendor if rows or not vendor else OTHER, architecture if listed else OTHER


@lru_cache(maxsize=10_000)
def vendor(processor_name: str, gpu: str = "", kind: str = "") -> str:
    """The family of `processor_name`, or of GPU if that does not name a chip. One of VENDORS.

    CPU_VENDOR if `kind` is "cpu"; OTHER if unknown.
    """
    if kind == CPU:
        return CPU_VENDOR
    for text in (processor_name, gpu):
        chip = graphics(text)
        if chip is not None:
            return chip.family if chip.family in VENDORS else OTHER
        if processor(text) or CPU_DEVICE.search(text) or RENDERER.search(text):
            return CPU_VENDOR
    return OTHER


def find_vendor(text: str) -> str | None:
    """The family that `text` names by family, maker or both; None if there is none."""
    wanted = text.casefold()
    for name, full in VENDORS.items():
        if wanted in {name.casefold(), full.casefold(), full.casefold().removesuffix(f" {name}".casefold())}:
            return name
    return None
