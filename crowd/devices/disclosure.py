"""What the public sees of a model: its name, or the group that rare models are shown under.

A name that few people's devices bear, with times of day and figures beside it, may tell who measured. Fewer
than FRONTRUNNER_RARE_BELOW installations make a model rare. This is the one place that decides; sessions
and figures are stored under its answer, so that every page, address and export says the same.
"""

from dataclasses import dataclass

from django.conf import settings

from crowd.devices.models import DeviceModel
from crowd.devices.normalisation import HANDHELD

PREFIX = "group|"


@dataclass(frozen=True)
class Group:
    """What rare models with one chip have in common; `key` is no model's, as no maker contains a bar."""

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


def is_named(rare: bool, show_model: bool) -> bool:
    """Whether a model is shown by its name, to an installation that wants SHOW_MODEL or not."""
    return show_model or not rare


def is_rare(installations: int) -> bool:
    """Whether a model measured by so many installations may not be named. A threshold of 1 names them all."""
    return installations < settings.FRONTRUNNER_RARE_BELOW
