"""Stores an exploration that another server measured. It is shown and starts others; it never continues."""

from pathlib import Path

from django.db import transaction

from crowd.audit.services import COMMAND_LINE, record
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from crowd.explorations.outcomes import exploration_file
from crowd.explorations.outcomes.exploration_file import InvalidExplorationError
from crowd.explorations.searching.search import COPIED
from crowd.fronts.models import FrontVersion
from wire.exploration import Document


class KnownExplorationError(ValueError):
    """The exploration is in the database already; the message names it."""


REFUSALS = (InvalidExplorationError, KnownExplorationError)


def import_file(path: Path, by: str = COMMAND_LINE) -> Exploration:
    """Store the exploration in the file `path`. Raises InvalidExplorationError and KnownExplorationError."""
    try:
        return store(exploration_file.parse(path.read_bytes()), by, f"from the file {path.name}")
    except OSError as error:
        raise InvalidExplorationError(f"{path} cannot be read: {error.strerror}") from error
    except REFUSALS as error:
        raise type(error)(f"{path}: {error}") from error


@transaction.atomic
def store(whole: Document, by: str, note: str = "") -> Exploration:
    """Store `whole`. Raises InvalidExplorationError and KnownExplorationError."""
    exploration = exploration_file.unsaved_exploration(whole)
    exploration.reference_device = _device(whole)
    if (stored := find(whole)) is not None:
        raise KnownExplorationError(f"{stored} is this exploration (digest {whole.sha256[:12]}...)")
    if slug := whole.exploration.prepares:
        exploration.prepares = FrontVersion.objects.filter(slug=slug).first()
        if exploration.prepares is None:
            raise InvalidExplorationError(
                f"exploration.prepares: there is no front {slug} here: import that first "
                "(frontrunner admin front import FILE)"
            )
    exploration.save()
    # The model sets the moment when a row is created.
    Exploration.objects.filter(pk=exploration.pk).update(created_at=whole.exploration.created_at)
    Evaluation.objects.bulk_create(exploration_file.unsaved_evaluations(whole, exploration))
    rows = f"{len(whole.evaluations)} evaluations, measured on {whole.machine}"
    record(by, "imported", f"exploration {exploration.pk}", f"{rows}, {note}", digest=whole.sha256)
    exploration.refresh_from_db()
    return exploration


def find(whole: Document) -> Exploration | None:
    """The exploration here with the content of `whole`, imported or measured; None without one."""
    twins = Exploration.objects.filter(created_at=whole.exploration.created_at)
    return next(
        (row for row in twins if exploration_file.digest(row, row.evaluations.all()) == whole.sha256), None
    )


def _device(whole: Document) -> ReferenceDevice:
    """The device that measured `whole`, locked, so that of two equal imports the second is refused."""
    devices = [row.device for row in whole.evaluations if row.device and row.phase not in COPIED]
    names = ", ".join(sorted({str(device.get("name")) for device in devices if device.get("name")}))
    backends = sorted({str(device["backend"]) for device in devices if device.get("backend")})
    device, _ = ReferenceDevice.objects.get_or_create(
        name=whole.reference_device,
        elsewhere=whole.machine,
        backend=backends[0][:16] if backends else "opencl",
        opencl_device=names[:200],
    )
    return ReferenceDevice.objects.select_for_update().get(pk=device.pk)
