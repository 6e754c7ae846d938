"""From a device's raw strings to the model people know: pure functions, run again when a rule gets better.

The key of a model holds names alone. Clocks, memory sizes and kernel builds differ between two devices of
one model, or between two days of one device, and would split it.
"""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from django.utils.text import slugify

UNKNOWN = "Unknown device"
SLUG_LENGTH = 100
# What a model is known by, and the driver that ran.
RAW_STRINGS = frozenset(
    {
        "board", "board_platform", "brand", "cpu", "egl", "manufacturer", "model", "opencl_device",
        "opencl_driver", "opencl_platform", "os", "soc_manufacturer", "soc_model",
    }
)  # fmt: skip
# What firmware says when nobody filled in the form.
PLACEHOLDERS = frozenset(
    {
        "", "0", "all series", "default string", "invalid", "n/a", "none", "not applicable", "not specified",
        "null", "o.e.m.", "oem", "system manufacturer", "system product name", "system version",
        "to be filled by o.e.m.", "undefined", "unknown",
    }
)  # fmt: skip
COMPANY = re.compile(
    r"[,.]?\s+(inc|incorporated|corp|corporation|co|company|ltd|limited|llc|gmbh|ag|s\.?a|b\.?v|plc)\b\.?,?",
    re.IGNORECASE,
)
# Makers write their own name in several ways; the way people know it.
MAKERS = {
    "asus": "ASUS", "asustek": "ASUS", "asustek computer": "ASUS", "dell": "Dell", "google": "Google",
    "hewlett-packard": "HP", "hp": "HP", "htc": "HTC", "huawei": "Huawei", "innotek": "VirtualBox",
    "lenovo": "Lenovo", "lg": "LG",
    "lge": "LG", "micro-star international": "MSI", "motorola": "Motorola", "msi": "MSI", "nokia": "Nokia",
    "nvidia": "NVIDIA", "oneplus": "OnePlus", "oppo": "OPPO", "qemu": "QEMU", "realme": "realme",
    "samsung": "Samsung", "sony": "Sony", "tcl": "TCL", "vivo": "vivo", "vmware": "VMware",
    "xiaomi": "Xiaomi", "zte": "ZTE",
}  # fmt: skip
CPU_NOISE = re.compile(
    r"\((r|tm|c)\)|\b(cpu|processor)\b|@.*$|\b\d+(\.\d+)?\s*[mg]hz\b|\b\d+-core\b|\bwith (radeon|amd)\b.*$",
    re.IGNORECASE,
)
SYSTEMS = {"android": "Android", "windows": "Windows", "macos": "macOS", "darwin": "macOS", "ios": "iOS"}
# Platforms whose devices are the processor itself, not a graphics chip.
CPU_PLATFORM = re.compile(r"portable computing language|pocl|oclgrind|intel\(r\) cpu", re.IGNORECASE)
CPU_DEVICE = re.compile(r"^(cpu|pthread|basic)\b|^pocl|\bcpu\b", re.IGNORECASE)


@dataclass(frozen=True)
class Identity:
    """What raw strings come to. `key` starts with the maker: no model merges across makers."""

    key: str
    slug: str
    manufacturer: str
    name: str
    cpu: str
    soc: str
    gpu: str
    os: str


def identify(raw: Mapping[str, Any]) -> Identity:
    """The identity behind RAW, the client's strings; every one may be absent or null."""
    system = operating_system(_text(raw, "os"))
    maker = manufacturer(_text(raw, "manufacturer") or _text(raw, "brand"))
    model = _without_prefix(_text(raw, "model") or _text(raw, "board"), maker)
    cpu = processor(_text(raw, "cpu"))
    soc = " ".join(filter(None, (_text(raw, "soc_manufacturer"), _text(raw, "soc_model"))))
    soc = soc or _text(raw, "board_platform")
    # A PC's product name says little of its speed, a virtual machine's nothing: the processor belongs to
    # the name.
    handheld = system in {"Android", "iOS", "macOS"}
    if handheld and model:
        name = model
    elif model and cpu:
        name = f"{model}, {cpu}"
    else:
        name = model or cpu or soc or (f"Unknown {system} device" if system else UNKNOWN)
    key = "|".join((maker, name)).casefold()[:200]
    return Identity(
        key=key,
        slug=slug_of(maker, name),
        manufacturer=maker[:100],
        name=name[:150],
        cpu=cpu[:150],
        soc=soc[:100],
        gpu=graphics(raw)[:150],
        os=system[:50],
    )


def slug_of(maker: str, name: str, key: str = "") -> str:
    """The name in addresses; with KEY, one that no other key shares."""
    slug = slugify(f"{maker} {name}")[:SLUG_LENGTH].strip("-") or "device"
    return f"{slug}-{hashlib.sha256(key.encode()).hexdigest()[:8]}" if key else slug


def manufacturer(text: str) -> str:
    """The maker's name without its legal form, written as people know it."""
    short = COMPANY.sub("", text).strip(" ,.")
    known = MAKERS.get(short.casefold())
    if known:
        return known
    return short.capitalize() if short.islower() or (short.isupper() and len(short) > 4) else short


def processor(text: str) -> str:
    """A processor's model without trade marks, clocks and core counts."""
    return " ".join(CPU_NOISE.sub(" ", text).split())


def operating_system(text: str) -> str:
    """The family: Android, Windows, macOS, iOS, Linux for every distribution; empty when unknown."""
    if not text:
        return ""
    return next((name for start, name in SYSTEMS.items() if text.casefold().startswith(start)), "Linux")


def graphics(raw: Mapping[str, Any]) -> str:
    """The graphics chip: the OpenCL device where it is one, else the name of Android's driver."""
    device, platform = _text(raw, "opencl_device"), _text(raw, "opencl_platform")
    if device and not CPU_PLATFORM.search(platform) and not CPU_DEVICE.search(device):
        return re.sub(r"\((r|tm)\)", "", device, flags=re.IGNORECASE)
    egl = _text(raw, "egl")
    return egl.capitalize() if egl.islower() else egl


def _text(raw: Mapping[str, Any], field: str) -> str:
    value = raw.get(field)
    if not isinstance(value, str):
        return ""
    text = " ".join(value.split())
    return "" if text.casefold() in PLACEHOLDERS else text


def _without_prefix(model: str, maker: str) -> str:
    """'HUAWEI NXT-L29' by Huawei is NXT-L29, so that the maker is not said twice."""
    if maker and model.casefold().startswith(f"{maker.casefold()} "):
        return model[len(maker) :].strip()
    return model
