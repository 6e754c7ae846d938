"""Explorations as files, their fronts as drafts and files."""

from pathlib import Path

from django.core.management.base import CommandError

from crowd.explorations.models import Exploration
from crowd.explorations.outcomes import exploration_file, publishing
from crowd.explorations.searching.applications import applications
from crowd.fronts import selectors, sequences
from crowd.fronts.content import front_file
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing import services as fronts
from wire.front import Content


def parse_front_name(path: Path) -> tuple[str, str]:
    """Application and version from `path`, the file of a front. Raises CommandError."""
    application, _, version = path.stem.rpartition("-")
    if not application or not version or path.suffix != ".json":
        raise CommandError(f"{path}: name it <application>-<version>.json")
    if not path.parent.is_dir():
        raise CommandError(f"{path}: there is no folder {path.parent}")
    return application, version


def draft(exploration: Exploration, path: Path) -> FrontVersion:
    """The draft of the front of `exploration` that `path` names; the prepared one, if it was prepared
    already.

    Raises CommandError.
    """
    content = _content(exploration, path)
    digest = front_file.digest(content)
    done = {"preparations__prepares_digest": digest, "preparations__state": Exploration.State.DONE}
    prepared = FrontVersion.objects.filter(**done).first()
    try:
        document, note = front_file.document(content), f"from exploration {exploration.pk}"
        return prepared or fronts.create_draft(document, note=note)
    except fronts.REFUSALS as error:
        raise CommandError(f"{exploration}: {error}") from error


def write_draft(front: FrontVersion, path: Path) -> str:
    """Write `front` to `path`. Returns a line about it. Raises CommandError."""
    content = selectors.content(selectors.front_in_any_state(front.pk))
    write(path, front_file.text(content))
    return f"{len(content.configurations)} points: {path}"


def write_front(exploration: Exploration, path: Path) -> str:
    """Write the front of `exploration`, a draft that is not prepared, to `path`. As `write_draft`."""
    content = _content(exploration, path)
    write(path, front_file.text(content))
    return f"{len(content.configurations)} points: {path}, a draft: import it, then prepare it"


def write_whole(exploration: Exploration, path: Path, machine: str) -> str:
    """Write all of `exploration`, measured on `machine`, to `path`. As `write_draft`."""
    try:
        whole = exploration_file.document(exploration, machine)
    except exploration_file.InvalidExplorationError as error:
        raise CommandError(str(error)) from error
    content = exploration_file.pack(whole)
    _write(path, content)
    return f"{len(whole.evaluations)} evaluations, {len(content)} bytes, digest {whole.sha256[:12]}: {path}"


def _content(exploration: Exploration, path: Path) -> Content:
    application, version = parse_front_name(path)
    if application not in (possible := applications(exploration)):
        names = " or ".join(f"{one}-<version>.json" for one in possible)
        raise CommandError(f"{path}: name it {names}")
    try:
        return front_file.check_draft(publishing.front_document(exploration, version, application))
    except (publishing.NothingToPublishError, front_file.InvalidFrontError, sequences.SequenceError) as error:
        raise CommandError(f"{exploration}: {error}") from error


def write(path: Path, text: str) -> None:
    """Write `text` to `path`. Raises CommandError if that fails."""
    _write(path, text.encode())


def _write(path: Path, content: bytes) -> None:
    try:
        path.write_bytes(content)
    except OSError as error:
        raise CommandError(f"{path} cannot be written: {error.strerror}") from error
