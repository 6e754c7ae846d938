"""Derives a device's identity from its raw strings. Pure functions, run again when rules change.

The key of a model contains only names, also unknown ones; it is never shown. It does not contain clock rates,
memory sizes or kernel builds: they differ between devices of one model and would split it.

An emulator computes on another machine than it reports, so its figures do not describe the model. A virtual
machine of a PC runs on the processor that it reports, so its figures count; it is only marked.
"""

import hashlib
import re
from collections.abc import Mapping
from typing import Any

from django.utils.text import slugify

from crowd.demo.mark import is_demo
from crowd.devices.naming import chips, computing, names
from crowd.devices.naming.chips import Processor, without_noise
from crowd.devices.naming.raw_device import RawDevice
from crowd.devices.naming.rules import one_of, table
from crowd.records.device import HANDHELD, Device

# Version of the rules; increase it with every change. Older descriptions are then derived again.
RULES = 5
UNKNOWN = "Unknown device"
SLUG_LENGTH = 100
SYSTEMS = {
    "android": "Android", "windows": "Windows", "macos": "macOS", "darwin": "macOS", "ios": "iOS",
    "ipados": "iOS", "chrome os": "ChromeOS", "chromeos": "ChromeOS",
}  # fmt: skip
# The `model_source` of a model that its owner chose.
STATED_BY_OWNER = "owner"
# What browsers report in place of a model.
GENERIC_MODELS = frozenset({"ipad", "iphone", "k", "mac", "macintosh"})
# Names of devices of which a browser only reports the system.
FORMS = {"Android": "Android device", "macOS": "Mac", "": "Device"}
# Names of the devices of a demo server (crowd.simulation).
SIMULATED_MAKER = "Simulated"
SIMULATED_NAME = re.compile(
    r"(?:phone|laptop|PC) \d{1,6} \((?:Adreno|Mali|PowerVR|Xclipse|NVIDIA|Radeon|Intel|CPU)-like\)", re.ASCII
)

DEVICE, UNKNOWN_DEVICE, EMULATOR, VIRTUAL = "device", "unknown", "emulator", "virtual"
# No other key begins with this: the strings of devices have no line breaks.
BROWSER_PREFIX = "browser\n"

_emulators = table("emulators")
EMULATED_PHONE = one_of(_emulators["phones"])
EMULATOR_IMAGES = frozenset(_emulators["images"])
PC_PROCESSOR = one_of(_emulators["pc_processors"])
EMULATED_PROCESSOR = one_of(_emulators["emulated_processors"])
VIRTUAL_MACHINE = one_of(_emulators["virtual_machines"])
# The strings in which a phone names its emulator.
EMULATOR_FIELDS = (
    "manufacturer", "brand", "model", "device", "product", "board", "board_platform", "soc_model", "egl",
    "cpu", "opencl_device",
)  # fmt: skip


class Identity(Device, frozen=True, kw_only=True):
    """The device that raw strings stand for, before its name is masked.

    `key` starts with the maker, so models never merge across makers. `kind` is DEVICE, UNKNOWN_DEVICE (the
    strings name no model), EMULATOR or VIRTUAL (a virtual machine of a PC).

    `machine` stays the same if another chip of the device computes. It equals `key`, except for a browser's
    device that is named only by its chip.

    `named`: manufacturer and name come from rules. Otherwise they may contain text that was sent, which only
    administrators see. `slug`, `cpu`, `soc`, `gpu` and `os` never contain such text.
    """

    key: str
    named: bool
    machine: str

    @property
    def distinct_slug(self) -> str:
        """The slug with a suffix that no other key shares."""
        return _distinct(self.slug, self.key)


def identify(raw: Mapping[str, Any]) -> Identity:
    """The identity behind `raw`, the strings of a client; each may be absent or null."""
    device = RawDevice.parse(raw)
    return identity_of(device, computing.processor_of(device))


def identity_of(raw: RawDevice, processor: Processor) -> Identity:
    """The identity behind `raw`, on which `processor` computed, as of `identify`."""
    system = operating_system(raw.os)
    maker = names.manufacturer(raw.manufacturer or raw.brand)
    model = names.without_maker(raw.model or raw.board, maker)
    if raw.is_browser:
        if not model or model.casefold() in GENERIC_MODELS:
            return _identify_by_chip(raw, processor, system)
        # A browser does not report the maker.
        maker = maker or names.maker_of(model)
    cpu = chips.processor(raw.cpu)
    soc = system_on_chip(raw, system)
    compared = _name(system, model, cpu or without_noise(raw.cpu), soc or raw.soc or raw.board_platform)
    key = "|".join((maker, compared)).casefold()[:200]
    listed = maker in names.LISTED or _is_simulated(maker)
    if _is_known(maker, model):
        name, named = _name(system, model, cpu, ""), True
    elif (cpu or soc) and not (model and _names_its_model(system)):
        # Only the chip of the device is known.
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
        gpu=graphics(raw, processor)[:150],
        os=system[:50],
        kind=kind_of(raw, system, maker, model or raw.cpu),
        named=named,
        machine=key,
    )


def _identify_by_chip(raw: RawDevice, processor: Processor, system: str) -> Identity:
    """The identity of a browser's device without a model: its form and the chip that computed.

    Both come from rules. No text that the browser sent becomes part of the key.
    """
    chip = "" if processor.name == computing.UNKNOWN_CHIP else processor.name
    if system == "iOS":
        tablet = raw.os.casefold().startswith("ipados") or raw.model.casefold() == "ipad"
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
        gpu=graphics(raw, processor),
        os=system,
        kind=kind if named or kind == EMULATOR else UNKNOWN_DEVICE,
        named=named,
        machine=f"{BROWSER_PREFIX}{maker}|{form}".casefold(),
    )


def _is_simulated(maker: str) -> bool:
    """Whether `maker` is that of a demo server's devices. On other servers it is a stranger's text."""
    return maker == SIMULATED_MAKER and is_demo()


def _is_known(maker: str, model: str) -> bool:
    """Whether rules know `maker` and `model`, so that they may be shown in public."""
    if _is_simulated(maker):
        return bool(SIMULATED_NAME.fullmatch(model))
    return (not maker or maker in names.LISTED) and names.is_known_model(maker, model)


def _names_its_model(system: str) -> bool:
    """Whether the model name of devices with `system` identifies their hardware.

    The product name of a PC or a virtual machine does not: the processor is added to its name.
    """
    return system in HANDHELD or system == "macOS"


def _name(system: str, model: str, cpu: str, soc: str) -> str:
    if model and cpu and not _names_its_model(system):
        return f"{model}, {cpu}"
    return model or cpu or soc or _unknown(system)


def _unknown(system: str) -> str:
    return f"Unknown {system} device" if system else UNKNOWN


def nameless_slug(system: str, key: str) -> str:
    """The slug of a model that no rule names; unique for `key`."""
    return _distinct(slugify(_unknown(system)), key)


def slug_of(maker: str, name: str, key: str = "") -> str:
    """A slug of `maker` and `name`; with `key`, one that no other key shares."""
    slug = slugify(f"{maker} {name}")[:SLUG_LENGTH].strip("-") or "device"
    return _distinct(slug, key) if key else slug


def _distinct(slug: str, key: str) -> str:
    return f"{slug}-{hashlib.sha256(key.encode()).hexdigest()[:8]}"


def kind_of(raw: RawDevice, system: str, maker: str, model: str) -> str:
    """DEVICE, UNKNOWN_DEVICE, EMULATOR or VIRTUAL."""
    if system in HANDHELD:
        strings = [getattr(raw, field) for field in EMULATOR_FIELDS]
        if any(EMULATED_PHONE.search(line) or line.casefold() in EMULATOR_IMAGES for line in strings):
            return EMULATOR
    else:
        is_arm = raw.architecture.casefold().startswith(("aarch64", "arm"))
        if (is_arm and PC_PROCESSOR.search(raw.cpu)) or EMULATED_PROCESSOR.search(raw.cpu):
            return EMULATOR
        if any(VIRTUAL_MACHINE.search(line) for line in (raw.manufacturer, raw.model, raw.board)):
            return VIRTUAL
    return UNKNOWN_DEVICE if names.names_no_model(maker, model) else DEVICE


def operating_system(line: str) -> str:
    """The family of systems: Android, Windows, macOS, iOS, or Linux for all others; empty if unknown."""
    if not line:
        return ""
    return next((name for start, name in SYSTEMS.items() if line.casefold().startswith(start)), "Linux")


def system_on_chip(raw: RawDevice, system: str) -> str:
    """The system on a chip, from its properties, the board's code name, or the kernel of an old phone.

    Old phones report it in place of the processor. Empty for a PC.
    """
    kernel = raw.cpu if system == "Android" else ""
    return chips.system_on_chip(raw.soc, raw.board_platform, kernel)


def graphics(raw: RawDevice, processor: Processor) -> str:
    """The graphics chip: `processor` if it is one, otherwise from Android's driver."""
    if processor.kind == chips.GPU and processor.name != computing.UNKNOWN_CHIP:
        return processor.name
    driver = chips.graphics(raw.egl)
    return driver.name if driver else ""
