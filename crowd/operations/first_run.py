"""Preparation of a server: tables, fronts, an administrator, static files. Each step may run again."""

import hashlib
import json
import re
import secrets
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from django.conf import settings
from django.contrib.auth import get_user_model
from django.contrib.staticfiles.finders import get_finders
from django.contrib.staticfiles.storage import ManifestStaticFilesStorage
from django.core.management import call_command
from django.db import connection

from crowd.audit import accounts
from crowd.audit.models import AuditEntry
from crowd.audit.services import acting
from crowd.database import damage
from crowd.database.upgrade import migrate
from crowd.demo import mark
from crowd.devices.models import Installation
from crowd.explorations.measuring.reference_devices import create_this_machine
from crowd.explorations.outcomes import importing
from crowd.explorations.outcomes.exploration_file import InvalidExplorationError
from crowd.fronts.content import front_file, plans
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing import second_person, services
from crowd.fronts.publishing.second_person import SERVER_START
from crowd.observability import metrics
from crowd.observability.environment import close_to_others
from groundwork import __version__

ADMINISTRATOR = "admin"


class RealServerError(Exception):
    """This server cannot become a demo; the message says why."""


def prepare(say: Callable[[str], object], address: str, demo: bool = False) -> None:
    """Run all steps. `say` receives a line for each change. `address` is the site's, with a slash at its end.

    A `demo` server stays one. Raises RealServerError if the database holds data of another server.
    """
    data = Path(settings.FRONTRUNNER_VAR)
    if closed := close_to_others(data):
        say(f"{data}: {closed} files and folders were open to other users of this machine; now only to yours")
    damage.check()
    migrate()
    if demo and not mark.is_demo():
        mark_demo()
    if mark.is_demo():
        say(mark.SENTENCE)
    create_this_machine()
    # Shipped explorations were measured, so a demo does not have them.
    for line in (*publish_shipped_fronts(), *(() if mark.is_demo() else import_shipped_explorations())):
        say(line)
    if not FrontVersion.objects.filter(state=FrontVersion.State.PUBLISHED).exists():
        say("No front is published: clients have nothing to measure. frontrunner admin front publish FILE")
    for slug in plans.to_prepare():
        say(
            f"{slug} was prepared with another version of the program, so clients are not offered it: "
            f"frontrunner admin front prepare {slug}"
        )
    for line in accounts.equal_names():
        say(line)
    with acting(SERVER_START):
        password = create_first_administrator()
    if password is not None:
        say(f"Administrator at {address}admin/: user {ADMINISTRATOR}, password {password} (shown only now)")
    collect_static_files()
    metrics.remove_old_copies(data / "metrics")


def mark_demo() -> None:
    """Mark this server, before anything is stored, as a demo. Raises RealServerError."""
    if FrontVersion.objects.exists() or Installation.objects.exists():
        raise RealServerError(
            f"the database {connection.settings_dict['NAME']} belongs to a real server: a demo needs an "
            "empty one, such as that of a new folder in FRONTRUNNER_VAR (make: DATA)"
        )
    mark.write()


def publish_shipped_fronts() -> Iterator[str]:
    """Publish the shipped fronts of applications without any front. Other new ones become drafts.

    Nothing that an operator published, retired, drafted or discarded changes. Yields a line for each front
    that is published, offered or refused.
    """
    used = set(FrontVersion.objects.values_list("application", flat=True))
    for path in sorted(Path(settings.FRONTRUNNER_FRONTS).glob("*.json"), key=_natural_order):
        try:
            document = front_file.read(path)
            if document.get("application") in used:
                yield from _offer(document)
                continue
            front, new = services.publish_content(document, SERVER_START)
        except services.REFUSALS as error:
            yield f"Not published: {path.name}: {error}"
            continue
        if new:
            points = front.configurations.filter(probe=False).count()
            yield f"Published the front {front.slug}: {points} configurations"


def _offer(document: dict[str, Any]) -> Iterator[str]:
    """Make the shipped front `document` a draft, unless this server has it, or had it and discarded it."""
    content = front_file.check(document)
    slug, digest = content.slug, front_file.digest(content)
    stored = FrontVersion.objects.filter(slug=slug).first()
    if stored is None:
        made = AuditEntry.objects.filter(actor=SERVER_START, action=second_person.DRAFTED)
        if made.filter(subject=slug, digest=digest).exists():
            return
        stored = services.create_draft(document, SERVER_START, f"ships with Frontrunner {__version__}")
    elif stored.digest != digest and second_person.last_author(stored) != SERVER_START:
        yield f"{slug} here is not the {slug} that ships with Frontrunner {__version__}: yours stays"
        return
    if stored.state == FrontVersion.State.DRAFT:
        yield (
            f"{slug} ships with Frontrunner {__version__} and is a draft here. Clients measure it once you "
            f"publish it: frontrunner admin front publish {slug}"
        )


def import_shipped_explorations() -> Iterator[str]:
    """Import shipped explorations that are new. Yields a line for each imported or refused one."""
    for path in sorted(Path(settings.FRONTRUNNER_EXPLORATIONS).glob("*.json.gz"), key=_natural_order):
        try:
            exploration = importing.import_file(path, by=SERVER_START)
        except importing.KnownExplorationError:
            continue
        except InvalidExplorationError as error:
            yield f"Not imported: {error}"
            continue
        yield f"Imported {exploration} from {path.name}, measured on {exploration.reference_device.elsewhere}"


def _natural_order(path: Path) -> list[int | str]:
    """A sort key by which version 10 comes after version 9."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", path.name)]


def create_first_administrator() -> str | None:
    """Create the account `admin` if there is no administrator.

    Returns its password, which is stored nowhere.
    """
    users = get_user_model()
    if users.objects.filter(is_superuser=True).exists():
        return None
    password = secrets.token_urlsafe(15)
    users.objects.create_superuser(ADMINISTRATOR, "", password)
    return password


def collect_static_files() -> None:
    """Collect and compress static files, unless the collected ones are complete and up to date."""
    stamp = Path(settings.STATIC_ROOT) / ".sources"
    sources = _static_sources()
    if stamp.exists() and stamp.read_text() == sources and _static_files_are_complete():
        return
    call_command("collectstatic", verbosity=0, interactive=False, clear=True)
    stamp.write_text(sources)


def _static_files_are_complete() -> bool:
    """Whether every file that pages may name is there."""
    try:
        manifest = Path(settings.STATIC_ROOT) / ManifestStaticFilesStorage.manifest_name
        names = set(json.loads(manifest.read_text())["paths"].values())
    except (OSError, ValueError, KeyError):
        return False
    return all((Path(settings.STATIC_ROOT) / name).is_file() for name in names)


def _static_sources() -> str:
    """A digest that changes when any static source file changes."""
    digest = hashlib.sha256()
    for finder in get_finders():
        for name, storage in finder.list([]):
            status = Path(storage.path(name)).stat()
            digest.update(f"{name} {storage.path(name)} {status.st_size} {status.st_mtime_ns}\n".encode())
    return digest.hexdigest()
