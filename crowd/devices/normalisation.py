"""From a device's raw strings to the model people know: pure functions, run again when a rule gets better.

The key of a model holds names alone. Clocks, memory sizes and kernel builds differ between two devices of
one model, or between two days of one device, and would split it.
"""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from django.utils.text import slugify

from crowd.devices import chips, names
from crowd.devices.emulators import is_emulator, is_virtual_machine
from crowd.devices.names import text

# Counts up with every change of a rule: descriptions derived by older rules are derived again.
RULES = 1
UNKNOWN = "Unknown device"
SLUG_LENGTH = 100
# What a model is known by, and the driver that ran.
RAW_STRINGS = frozenset(
    {
        "board", "board_platform", "brand", "cpu", "device", "egl", "manufacturer", "model",
        "opencl_device", "opencl_driver", "opencl_platform", "os", "product", "soc_manufacturer",
        "soc_model",
    }
)  # fmt: skip
SYSTEMS = {"android": "Android", "windows": "Windows", "macos": "macOS", "darwin": "macOS", "ios": "iOS"}
HANDHELD = frozenset({"Android", "iOS"})
# Platforms whose devices are the processor itself, not a graphics chip.
CPU_PLATFORM = re.compile(r"portable computing language|pocl|oclgrind|intel\(r\) cpu", re.IGNORECASE)

DEVICE, UNKNOWN_DEVICE, EMULATOR, VIRTUAL = "device", "unknown", "emulator", "virtual"
SIMULATED = "simulated"
# Begins no other model's key: what devices say of themselves is one line each.
SIMULATED_PREFIX = "simulated\n"


@dataclass(frozen=True)
class Identity:
    """What raw strings come to. `key` starts with the maker: no model merges across makers. `kind` is DEVICE,
    UNKNOWN_DEVICE (its strings tell no model), EMULATOR or VIRTUAL (a PC's virtual machine); SIMULATED where
    nobody has the device.
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
    named: bool = True

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
    identity = _identify(raw)
    if not simulated:
        return identity
    return replace(
        identity,
        key=f"{SIMULATED_PREFIX}{identity.key}"[:200],
        slug=f"simulated-{identity.slug.removeprefix('simulated-')}",
        kind=SIMULATED,
    )


def _identify(raw: Mapping[str, Any]) -> Identity:
    system = operating_system(text(raw, "os"))
    maker = names.manufacturer(text(raw, "manufacturer") or text(raw, "brand"))
    model = names.without_maker(text(raw, "model") or text(raw, "board"), maker)
    cpu = chips.processor(text(raw, "cpu"))
    soc = system_on_chip(raw, system)
    # A PC's product name says little of its speed, a virtual machine's nothing: the processor belongs to
    # the name.
    if model and (system in HANDHELD or system == "macOS"):
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
        kind=kind_of(raw, system, maker, model or cpu),
    )


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
    board = text(raw, "board_platform")
    if system == "Android":
        kernel = chips.system_on_chip(text(raw, "cpu"))
        return chips.system_on_chip(told, board, kernel if kernel != text(raw, "cpu") else "")
    return chips.system_on_chip(told, board)


def graphics(raw: Mapping[str, Any]) -> str:
    """The graphics chip: the OpenCL device where it is one, else the name of Android's driver."""
    if not CPU_PLATFORM.search(text(raw, "opencl_platform")):
        chip = chips.graphics(text(raw, "opencl_device"))
        if chip is not None:
            return chip.name
    driver = chips.graphics(text(raw, "egl"))
    return driver.name if driver else ""
