"""The public name of a device model: its own name, or a mask that only names its chip.

The name of a rare device, together with times and figures, may reveal who measured. A name that no rule,
catalogue or administrator knows may be text of a stranger. Such a model is masked: pages, API and open data
name it by its chip, under an address that reveals nothing else. It keeps its figures. The mask is applied
when rows are read; sessions and figures are stored under the real model.

A model is named if its name is known, and either FRONTRUNNER_RARE_BELOW installations measured it or all of
its participants agreed.
"""

from django.conf import settings

from crowd.demo.mark import is_demo
from crowd.devices.models import DeviceModel
from crowd.devices.naming.chips import vendor
from crowd.devices.naming.computing import UNKNOWN_CHIP
from crowd.devices.naming.identity import slug_of
from crowd.records.device import HANDHELD, Device

# The columns that `public_device` reads.
COLUMNS = (
    "pk", "slug", "manufacturer", "name", "market_name", "cpu", "soc", "gpu", "os", "kind", "named", "rare",
    "consented", "mask",
)  # fmt: skip
# Letters in place of digits.
LETTERS = str.maketrans("0123456789", "ghjkmnpqrs")


def public_device(model: DeviceModel) -> Device:
    """`model` as the public sees it."""
    if shown := is_disclosed(model):
        slug, maker, name = model.slug, model.manufacturer, model.display_name
        parts = {"cpu": model.cpu, "soc": model.soc, "gpu": model.gpu}
    else:
        chip, parts = _chip(model)
        slug, maker, name = f"{slug_of('', chip)}-{model.mask}", "", f"{chip} ({mask_letters(model.mask)})"
    return Device(
        slug=slug,
        manufacturer=maker,
        name=name,
        cpu=parts.get("cpu", ""),
        soc=parts.get("soc", ""),
        gpu=parts.get("gpu", ""),
        os=model.os,
        kind=model.kind,
        simulated=is_demo(),
        masked=not shown,
        vendor=vendor("", parts.get("gpu", "")),
    )


def mask_letters(mask: str) -> str:
    """What tells masked models with one chip apart: letters, as a digit would fit searches for names."""
    return mask[:4].translate(LETTERS)


def is_disclosed(model: DeviceModel) -> bool:
    """Whether the public sees the name of `model`."""
    return model.named and (not model.rare or model.consented)


def find(slug: str) -> DeviceModel | None:
    """The model at the public address `slug`.

    None if there is none, also for the real slug of a masked model.
    """
    model = DeviceModel.objects.filter(slug=slug).first()
    if model is not None and is_disclosed(model):
        return model
    masked = DeviceModel.objects.filter(mask=slug.rpartition("-")[2]).first()
    return masked if masked is not None and public_device(masked).slug == slug else None


def is_rare(installations: int) -> bool:
    """Whether a model measured by this many `installations` needs a mask."""
    return installations < settings.FRONTRUNNER_RARE_BELOW


def _chip(model: DeviceModel) -> tuple[str, dict[str, str]]:
    """The masked name of `model`, and the chips that are shown with it.

    A phone is named by its system on a chip, a PC by its processor, otherwise by the graphics chip. The
    graphics chip of a system on a chip is shown, because it always has the same one.
    """
    form = "device" if model.os in HANDHELD or not model.os else "Mac" if model.os == "macOS" else "PC"
    if model.kind == DeviceModel.Kind.EMULATOR:
        return f"{model.os} emulator".strip(), {}
    if model.soc:
        # With a system on a chip it is a small device, whatever system it runs.
        return f"{model.soc} device", {"soc": model.soc, "gpu": model.gpu}
    if model.cpu and form != "device":
        return f"{model.cpu} {form}", {"cpu": model.cpu}
    if model.gpu:
        return f"{model.gpu} {form}", {"gpu": model.gpu}
    return f"{f'{model.os} {form}' if model.os else 'Device'}, {UNKNOWN_CHIP}", {}
