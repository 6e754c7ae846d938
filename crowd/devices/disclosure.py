"""What the public sees of a model: its name, or the group that rare models are shown under.

A name that few people's devices bear, with times of day and figures beside it, may tell who measured. Fewer
than FRONTRUNNER_RARE_BELOW installations make a model rare. This is the one place that decides; sessions
and figures are stored under its answer, so that every page, address and export says the same. A simulated
model is nobody's and never rare.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from django.conf import settings

from crowd.devices.models import DeviceModel
from crowd.devices.normalisation import HANDHELD

# Begins no model's key: what devices say of themselves is one line each.
PREFIX = "group\n"


@dataclass(frozen=True)
class Group:
    """What rare models with one chip have in common; `key` is no model's."""

    name: str
    cpu: str = ""
    soc: str = ""
    gpu: str = ""
    os: str = ""

    @property
    def key(self) -> str:
        return f"{PREFIX}{self.name}".casefold()[:200]


def group_of(model: DeviceModel) -> Group:
    """A phone's group is its system on a chip, a PC's its processor; else the graphics chip; else the system.

    A system on a chip has one graphics chip, which is told with it; a processor goes with many.
    """
    if model.kind == DeviceModel.Kind.SIMULATED:
        return Group("Simulated device")
    if model.kind == DeviceModel.Kind.EMULATOR:
        return Group(f"{model.os} emulator".strip(), os=model.os)
    form = "device" if model.os in HANDHELD or not model.os else "Mac" if model.os == "macOS" else "PC"
    if model.soc:
        # What has one is no desktop, whatever it runs.
        return Group(f"{model.soc} device", soc=model.soc, gpu=model.gpu, os=model.os)
    if model.cpu and form != "device":
        return Group(f"{model.cpu} {form}", cpu=model.cpu, os=model.os)
    if model.gpu:
        return Group(f"{model.gpu} {form}", gpu=model.gpu, os=model.os)
    return Group(f"Other {model.os} {form}" if model.os else "Other device", os=model.os)


def published(model: DeviceModel, show_model: bool) -> DeviceModel:
    """The row that the public sees of MODEL's sessions by an installation that wants SHOW_MODEL or not.

    No query where model.canonical and the group of the shown model were fetched.
    """
    shown = model.shown
    if is_named(shown.rare, show_model):
        return shown
    assert shown.group is not None  # recognition gives every model its group
    return shown.group


def columns(model: str) -> tuple[str, ...]:
    """The columns that `Shown.of` reads, for a query by bare columns; MODEL is the path to the model."""
    return tuple(
        f"{model}__{path}{name}" for path in ("", "canonical__") for name in ("pk", "rare", "group_id")
    )


@dataclass(frozen=True)
class Shown:
    """The model that a device is shown as, whether it is rare, and its group, by primary keys (None: no group
    yet).
    """

    model: int
    rare: bool
    group: int | None

    @classmethod
    def of(cls, values: Sequence[Any]) -> "Shown":
        """Out of the values of `columns`."""
        own, canonical = values[:3], values[3:]
        return cls(*(own if canonical[0] is None else canonical))

    def public(self, show_model: bool) -> int | None:
        """As `published`, by primary keys."""
        return self.model if is_named(self.rare, show_model) else self.group


def is_named(rare: bool, show_model: bool) -> bool:
    """Whether a model is shown by its name, to an installation that wants SHOW_MODEL or not."""
    return show_model or not rare


def is_rare(installations: int) -> bool:
    """Whether a model measured by so many installations may not be named. A threshold of 1 names them all."""
    return installations < settings.FRONTRUNNER_RARE_BELOW
