"""From a device's raw strings to the model people know: pure functions, run again when a rule gets better.

The key of a model holds names alone, also ones that no rule knows: it is never shown. Clocks, memory sizes
and kernel builds differ between two devices of one model, or between two days of one device, and would
split it.
"""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from django.utils.text import slugify

from crowd.devices import chips
from crowd.devices.chips.central_processors import without_noise
from crowd.devices.naming import model_names, names, processors
from crowd.devices.naming.browsers import is_browser
from crowd.devices.naming.emulators import is_emulator, is_virtual_machine
from crowd.devices.naming.names import text

# Counts up with every change of a rule: descriptions derived by older rules are derived again.
RULES = 3
UNKNOWN = "Unknown device"
SLUG_LENGTH = 100
# What a model is known by, and the driver that ran.
RAW_STRINGS = frozenset(
    {
        "board", "board_platform", "brand", "browser", "browser_version", "cpu", "device", "egl",
        "gpu_architecture", "gpu_description", "gpu_device", "gpu_fallback", "gpu_vendor", "manufacturer",
        "model", "model_source", "opencl_device", "opencl_driver", "opencl_platform", "os", "product",
        "soc_manufacturer", "soc_model",
    }
)  # fmt: skip
SYSTEMS = {
    "android": "Android", "windows": "Windows", "macos": "macOS", "darwin": "macOS", "ios": "iOS",
    "ipados": "iOS", "chrome os": "ChromeOS", "chromeos": "ChromeOS",
}  # fmt: skip
# `model_source` of a model that no browser named.
STATED_BY_OWNER = "owner"
# What browsers say in place of a model.
NO_MODELS = frozenset({"ipad", "iphone", "k", "mac", "macintosh"})
# What a browser's device is called where nothing but its system is known.
FORMS = {"Android": "Android device", "macOS": "Mac", "": "Device"}
HANDHELD = frozenset({"Android", "iOS"})
# What the simulation calls its devices (crowd.results.simulation).
SIMULATED_MAKER = "Simulated"
SIMULATED_NAME = re.compile(
    r"(?:phone|laptop|PC) \d{1,6} \((?:Adreno|Mali|PowerVR|NVIDIA|Radeon|Intel|CPU)-like\)", re.ASCII
)

DEVICE, UNKNOWN_DEVICE, EMULATOR, VIRTUAL = "device", "unknown", "emulator", "virtual"
SIMULATED = "simulated"
# Begin no other model's key: what devices say of themselves is one line each.
SIMULATED_PREFIX = "simulated\n"
BROWSER_PREFIX = "browser\n"


@dataclass(frozen=True)
class Identity:
    """What raw strings come to. `key` starts with the maker: no model merges across makers. `kind` is DEVICE,
    UNKNOWN_DEVICE (its strings name no model), EMULATOR or VIRTUAL (a PC's virtual machine); SIMULATED where
    nobody has the device.

    `machine` stays the same when another chip of the device computes: it is the key, unless the name of that
    chip is all that a browser says of the model.

    `named` says that manufacturer and name come from rules. Where it is False they may hold the text that
    came, for administrators alone. `slug`, `cpu`, `soc`, `gpu` and `os` never do.
    """

    key: str
    slug: str
    manufacturer: str
    name: str
    cpu: str
    soc: str
    gpu: str
    os: str
    kind: str
    named: bool
    machine: str

    @property
    def distinct_slug(self) -> str:
        """The name in addresses that no other key shares."""
        return _distinct(self.slug, self.key)

    @property
    def emulator(self) -> bool:
        """Whether its figures say nothing of the device that it names."""
        return self.kind == EMULATOR


def identify(raw: Mapping[str, Any], simulated: bool = False) -> Identity:
    """The identity behind RAW, the client's strings; every one may be absent or null. That of a SIMULATED
    device is never one of a device that somebody has, whatever the strings.
    """
    identity = _identify(raw, simulated)
    if not simulated:
        return identity
    return replace(
        identity,
        key=f"{SIMULATED_PREFIX}{identity.key}"[:200],
        slug=f"simulated-{identity.slug.removeprefix('simulated-')}",
        kind=SIMULATED,
    )


def _identify(raw: Mapping[str, Any], simulated: bool) -> Identity:
    system = operating_system(text(raw, "os"))
    maker = names.manufacturer(text(raw, "manufacturer") or text(raw, "brand"))
    model = names.without_maker(text(raw, "model") or text(raw, "board"), maker)
    if is_browser(raw):
        if not model or model.casefold() in NO_MODELS:
            return _without_model(raw, system)
        # A browser names no maker.
        maker = maker or model_names.maker_of(model)
    cpu = chips.processor(text(raw, "cpu"))
    soc = system_on_chip(raw, system)
    compared = _name(system, model, cpu or without_noise(text(raw, "cpu")), soc or _raw_soc(raw))
    key = "|".join((maker, compared)).casefold()[:200]
    listed = names.is_known_maker(maker) or (simulated and maker == SIMULATED_MAKER)
    if _is_known(maker, model, simulated):
        name, named = _name(system, model, cpu, ""), True
    elif (cpu or soc) and not (model and _names_its_model(system)):
        # Nothing is known of the device but its chip.
        name, named, maker = cpu or soc, True, maker if listed else ""
    else:
        name, named = compared, False
    if named or name == _unknown(system):
        slug = slug_of(maker if listed else "", name)
    else:
        slug = nameless_slug(system, key)
    return Identity(
        key=key,
        slug=slug,
        manufacturer=maker[:100],
        name=name[:150],
        cpu=cpu[:150],
        soc=soc[:100],
        gpu=graphics(raw)[:150],
        os=system[:50],
        kind=kind_of(raw, system, maker, model or text(raw, "cpu")),
        named=named,
        machine=key,
    )


def _without_model(raw: Mapping[str, Any], system: str) -> Identity:
    """Of a device that a browser says no model of: its form and the chip that computed, both as rules call
    them. Nothing that the browser sent is part of the key.
    """
    processor = processors.processor_of(raw)
    chip = "" if processor.name == processors.UNKNOWN_CHIP else processor.name
    if system == "iOS":
        tablet = text(raw, "os").casefold().startswith("ipados") or text(raw, "model").casefold() == "ipad"
        maker, form = "Apple", "iPad" if tablet else "iPhone"
        name = form
    else:
        maker, form = "", FORMS.get(system, f"{system} PC")
        name = f"{form}, {chip}" if chip else _unknown(system)
    named = name != _unknown(system)
    kind = kind_of(raw, system, maker, name)
    return Identity(
        key=f"{BROWSER_PREFIX}{maker}|{name}".casefold(),
        slug=slug_of(maker, name),
        manufacturer=maker,
        name=name,
        cpu="",
        soc="",
        gpu=graphics(raw),
        os=system,
        kind=kind if named or kind == EMULATOR else UNKNOWN_DEVICE,
        named=named,
        machine=f"{BROWSER_PREFIX}{maker}|{form}".casefold(),
    )


def _is_known(maker: str, model: str, simulated: bool) -> bool:
    """Whether rules know MAKER and MODEL, which the public may then see as they are."""
    if simulated and maker == SIMULATED_MAKER:
        return bool(SIMULATED_NAME.fullmatch(model))
    return (not maker or names.is_known_maker(maker)) and model_names.is_known_model(maker, model)


def _names_its_model(system: str) -> bool:
    """Whether devices with SYSTEM say what people call them. A PC's product name says little of its speed, a
    virtual machine's nothing: the processor belongs to its name.
    """
    return system in HANDHELD or system == "macOS"


def _name(system: str, model: str, cpu: str, soc: str) -> str:
    if model and cpu and not _names_its_model(system):
        return f"{model}, {cpu}"
    return model or cpu or soc or _unknown(system)


def _unknown(system: str) -> str:
    return f"Unknown {system} device" if system else UNKNOWN


def _raw_soc(raw: Mapping[str, Any]) -> str:
    told = " ".join(filter(None, (text(raw, "soc_manufacturer"), text(raw, "soc_model"))))
    return told or text(raw, "board_platform")


def nameless_slug(system: str, key: str) -> str:
    """The name in addresses of a model that no rule names; no other KEY has it."""
    return _distinct(slugify(_unknown(system)), key)


def slug_of(maker: str, name: str, key: str = "") -> str:
    """The name in addresses; with KEY, one that no other key shares."""
    slug = slugify(f"{maker} {name}")[:SLUG_LENGTH].strip("-") or "device"
    return _distinct(slug, key) if key else slug


def _distinct(slug: str, key: str) -> str:
    return f"{slug}-{hashlib.sha256(key.encode()).hexdigest()[:8]}"


def kind_of(raw: Mapping[str, Any], system: str, maker: str, model: str) -> str:
    """Which of DEVICE, UNKNOWN_DEVICE, EMULATOR and VIRTUAL the strings come to."""
    handheld = system in HANDHELD
    if is_emulator(raw, handheld):
        return EMULATOR
    if not handheld and is_virtual_machine(raw):
        return VIRTUAL
    return UNKNOWN_DEVICE if names.says_nothing(maker, model) else DEVICE


def operating_system(line: str) -> str:
    """The family: Android, Windows, macOS, iOS, Linux for every distribution; empty when unknown."""
    if not line:
        return ""
    return next((name for start, name in SYSTEMS.items() if line.casefold().startswith(start)), "Linux")


def system_on_chip(raw: Mapping[str, Any], system: str) -> str:
    """The system on a chip, by the properties that name it, the board's code name, or an old phone's kernel
    (which writes it where others write the processor). Empty for a PC.
    """
    told = " ".join(filter(None, (text(raw, "soc_manufacturer"), text(raw, "soc_model"))))
    kernel = text(raw, "cpu") if system == "Android" else ""
    return chips.system_on_chip(told, text(raw, "board_platform"), kernel)


def graphics(raw: Mapping[str, Any]) -> str:
    """The graphics chip: the OpenCL device where it is one, else the name of Android's driver."""
    computed = processors.processor_of(raw)
    if computed.kind == processors.GPU and computed.name != processors.UNKNOWN_CHIP:
        return computed.name
    driver = chips.graphics(text(raw, "egl"))
    return driver.name if driver else ""
