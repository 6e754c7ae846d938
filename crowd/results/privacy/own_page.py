"""The private page of a participant, which shows the exact model of the device.

The link contains the installation's id and a signature. It only gives read access: erasing needs the token.
It works until the installation is erased, even after its token was revoked.
"""

from dataclasses import dataclass
from uuid import UUID

from django.core.signing import BadSignature, Signer
from django.db.models import Count, Q, QuerySet

from crowd.devices.models import DeviceDescription, DeviceModel, Installation
from crowd.devices.naming.identity import STATED_BY_OWNER
from crowd.records.device import Device
from crowd.records.session import SessionRow
from crowd.results.reading import selectors

SALT = "own page"
LISTED_SESSIONS = 50


@dataclass(frozen=True)
class OwnDevice:
    """A device of the installation, by its exact name and as the public sees it.

    `stated`: its owner chose the name, because the browser does not report it.
    """

    title: str
    public: Device
    sessions: tuple[SessionRow, ...]
    stated: bool

    @property
    def named(self) -> bool:
        """Whether the device is named in public."""
        return self.title == self.public.title


@dataclass(frozen=True)
class OwnPage:
    """The content of the page. `show_model`: the model is named in public even if rare."""

    devices: tuple[OwnDevice, ...]
    show_model: bool
    session_count: int


def own_page_path(installation: Installation) -> str:
    """The path of the private page of `installation`. Anyone who has it can read the page."""
    return f"/mine/{Signer(salt=SALT).sign(installation.pk.hex)}/"


def own_page(signed: str) -> OwnPage | None:
    """The page for `signed`, the last part of the path; None if it is invalid or the installation is
    erased."""
    try:
        key = UUID(hex=Signer(salt=SALT).unsign(signed))
    except (BadSignature, ValueError):
        return None
    there = Installation.objects.filter(pk=key)
    installation = there.annotate(count=Count("sessions")).first()
    if installation is None:
        return None
    models = DeviceModel.objects.filter(descriptions__sessions__installation=installation).distinct()
    devices = [
        _device(installation, model.canonical_or_self)
        for model in models.select_related("canonical").order_by("pk")
    ]
    return OwnPage(tuple(row for row in devices if row), installation.show_model, installation.count)


def _device(installation: Installation, model: DeviceModel) -> OwnDevice | None:
    sessions = selectors.own_sessions(installation, model, LISTED_SESSIONS)
    if not sessions:
        return None
    sent = DeviceDescription.objects.filter(
        sessions__installation=installation, model__in=_with_aliases(model)
    )
    stated = sent.filter(raw__model_source=STATED_BY_OWNER).exists()
    return OwnDevice(str(model), sessions[0].device, sessions, stated)


def _with_aliases(model: DeviceModel) -> QuerySet[DeviceModel]:
    """`model` and its aliases."""
    return DeviceModel.objects.filter(Q(pk=model.pk) | Q(canonical=model.pk))
