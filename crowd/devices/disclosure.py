"""What the public sees of a device model: its name, or a mask that says its chip alone.

A name that few people's devices bear, with times of day and figures beside it, may tell who measured; a name
that no rule, catalogue or administrator knows may be anybody's words. Such a model is masked: it keeps its
figures, and pages, API and open data call it by its chip under an address that says nothing else. The mask is
applied when rows are read; sessions and figures are stored under the model itself.

A model has its name where that is known, and either FRONTRUNNER_RARE_BELOW installations measured it or all
that did agreed to it. A simulated model belongs to nobody and is never masked.
"""

from dataclasses import dataclass

from django.conf import settings

from crowd.devices.models import DeviceModel
from crowd.devices.naming.normalisation import HANDHELD, slug_of
from crowd.devices.naming.processors import UNKNOWN_CHIP

# What `public_device` reads of a model.
COLUMNS = (
    "pk", "slug", "manufacturer", "name", "market_name", "cpu", "soc", "gpu", "os", "kind", "named", "rare",
    "consented", "mask",
)  # fmt: skip


@dataclass(frozen=True)
class PublicDevice:
    """A device model as everybody may see it; empty text where nothing is known. `masked`: by its chip."""

    slug: str
    manufacturer: str
    name: str
    cpu: str
    soc: str
    gpu: str
    os: str
    kind: str
    masked: bool


def public_device(model: DeviceModel) -> PublicDevice:
    """What the public sees of MODEL."""
    if is_disclosed(model):
        return PublicDevice(
            slug=model.slug,
            manufacturer=model.manufacturer,
            name=model.shown_name,
            cpu=model.cpu,
            soc=model.soc,
            gpu=model.gpu,
            os=model.os,
            kind=model.kind,
            masked=False,
        )
    name, parts = _chip(model)
    return PublicDevice(
        slug=_masked_slug(name, model.mask),
        manufacturer="",
        name=name,
        cpu=parts.get("cpu", ""),
        soc=parts.get("soc", ""),
        gpu=parts.get("gpu", ""),
        os=model.os,
        kind=model.kind,
        masked=True,
    )


def is_disclosed(model: DeviceModel) -> bool:
    """Whether the public sees MODEL by its name."""
    if model.kind == DeviceModel.Kind.SIMULATED:
        return True
    return model.named and (not model.rare or model.consented)


def find(slug: str) -> DeviceModel | None:
    """The model at the public address SLUG; None where there is none, also for the name of a masked one."""
    model = DeviceModel.objects.filter(slug=slug).first()
    if model is not None and is_disclosed(model):
        return model
    masked = DeviceModel.objects.filter(mask=slug.rpartition("-")[2]).first()
    return masked if masked is not None and public_device(masked).slug == slug else None


def is_rare(installations: int) -> bool:
    """Whether a model measured by so many installations needs a mask. A threshold of 1 masks none."""
    return installations < settings.FRONTRUNNER_RARE_BELOW


def _masked_slug(name: str, mask: str) -> str:
    return f"{slug_of('', name)}-{mask}"


def _chip(model: DeviceModel) -> tuple[str, dict[str, str]]:
    """The name by which a mask calls MODEL, and the parts that it shows.

    A phone is called by its system on a chip, a PC by its processor, else by the graphics chip. A system on a
    chip has one graphics chip, which is shown with it; a processor goes with many.
    """
    form = "device" if model.os in HANDHELD or not model.os else "Mac" if model.os == "macOS" else "PC"
    if model.kind == DeviceModel.Kind.EMULATOR:
        return f"{model.os} emulator".strip(), {}
    if model.soc:
        # What has one is a small device, whatever system it runs.
        return f"{model.soc} device", {"soc": model.soc, "gpu": model.gpu}
    if model.cpu and form != "device":
        return f"{model.cpu} {form}", {"cpu": model.cpu}
    if model.gpu:
        return f"{model.gpu} {form}", {"gpu": model.gpu}
    return f"{f'{model.os} {form}' if model.os else 'Device'}, {UNKNOWN_CHIP}", {}
