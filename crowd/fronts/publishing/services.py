"""Writes of fronts: a draft, its review, publication and retirement. Each is one logged transaction."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from django.core.exceptions import ValidationError
from django.db import transaction
from django.utils import timezone

from crowd.audit.models import AuditEntry
from crowd.audit.services import COMMAND_LINE, record
from crowd.fronts import selectors, sequences, trajectories
from crowd.fronts.content import front_file, plans
from crowd.fronts.models import PERMITTED, Configuration, FrontVersion, TransitionError
from crowd.fronts.publishing import second_person
from crowd.fronts.publishing.second_person import DRAFTED, REPLACED, SUBMITTED
from slam.configuration import ConfigurationError

State = FrontVersion.State


class FrontConflictError(ValueError):
    """Different content under a version that is not a draft any more; the remedy is a new version."""


REFUSALS = (
    *(front_file.InvalidFrontError, sequences.SequenceError, FrontConflictError),
    second_person.SecondPersonError,
)


@transaction.atomic
def create_draft(document: dict[str, Any], by: str = COMMAND_LINE, note: str = "") -> FrontVersion:
    """A draft with DOCUMENT's content (a front file's shape); an earlier draft of that version is replaced.

    Raises InvalidFrontError, SequenceError, or FrontConflictError where the version is not a draft any more,
    or is another person's draft with other content.
    """
    content = front_file.check(document)
    document = front_file.canonical(document)
    slug = f"{content.application}-{document['version']}"
    front = FrontVersion.objects.select_for_update().filter(slug=slug).first()
    if front is not None and front.state != State.DRAFT:
        raise FrontConflictError(f"{slug} is {front.get_state_display()}: give this content another version")
    digest = front_file.digest(document)
    if front is not None and front.digest != digest:
        _refuse_anothers(front, by)
    sequence = _sequence(document["sequence"])
    if content.protocol.frames > sequence["frames"]:
        raise front_file.InvalidFrontError(
            f"not a front: protocol.frames: {content.protocol.frames}, but {sequence['name']} has only "
            f"{sequence['frames']}"
        )
    if content.application == plans.KFUSION:
        _check_plans(document)
    action = DRAFTED if front is None else REPLACED
    if front is None:
        front = FrontVersion(
            slug=slug, application=content.application, version=document["version"], state=State.DRAFT
        )
    front.digest = digest
    front.protocol = document["protocol"]
    front.sequence = sequence
    front.provenance = document["provenance"]
    front.save()
    front.configurations.all().delete()
    points, probes = document["configurations"], document.get("probes", [])
    Configuration.objects.bulk_create(
        _configuration(front, position, point, probe=position >= len(points))
        for position, point in enumerate([*points, *probes])
    )
    trajectories.delete_unused()
    _log(front, action, "", by, note)
    return front


@transaction.atomic
def discard(front: FrontVersion, by: str = COMMAND_LINE) -> None:
    """Delete a draft that was never in review. Raises ValidationError for any other."""
    if front.audit.exists():
        raise ValidationError(f"{front.slug} was in review, so it is kept: correct it with a new draft of it")
    record(by, "discarded", front.slug, from_state=front.state, digest=front.digest)
    front.delete()
    trajectories.delete_unused()


def submit(front: FrontVersion, by: str = COMMAND_LINE, note: str = "") -> FrontVersion:
    """Hand a draft in for review: its content is fixed from here on. Raises TransitionError."""
    return _move(front, State.IN_REVIEW, SUBMITTED, by, note)


def send_back(front: FrontVersion, by: str = COMMAND_LINE, note: str = "") -> FrontVersion:
    """Make what is in review a draft again. Raises TransitionError."""
    return _move(front, State.DRAFT, "sent back", by, note)


def publish(front: FrontVersion, by: str = COMMAND_LINE, note: str = "") -> FrontVersion:
    """Make what is in review what clients measure, for good. Raises TransitionError.

    Its sequence must still be whole, or clients could not fetch it: raises SequenceError. Content that
    does not fit its digest is not published: raises FrontConflictError. Raises SecondPersonError where the
    deployment demands two people and BY drafted or submitted the content.
    """
    return _move(front, State.PUBLISHED, "published", by, note)


def retire(front: FrontVersion, by: str = COMMAND_LINE, note: str = "") -> FrontVersion:
    """Clients are not asked to measure it any more; its results stay, and late ones are still accepted.

    Raises TransitionError for what is not published.
    """
    return _move(front, State.RETIRED, "retired", by, note)


@transaction.atomic
def publish_again(front: FrontVersion, by: str = COMMAND_LINE) -> FrontVersion:
    """Roll back: publish the content of an earlier FRONT as its application's next version.

    Where the deployment demands two people, the new version is left in review for another person.
    Raises TransitionError for what was never published, and what publish raises.
    """
    if front.state not in (State.PUBLISHED, State.RETIRED):
        raise TransitionError(front.slug, front.state, "published again")
    content = selectors.document(selectors.any_front(front.pk))
    content["version"] = selectors.next_version(front.application)
    content["provenance"] = content["provenance"] | {"published_again_from": front.slug}
    note = f"the content of {front.slug} again"
    again = submit(create_draft(content, by, note), by, note)
    return again if second_person.needed() else publish(again, by, note)


def published(document: dict[str, Any]) -> FrontVersion | None:
    """The published or retired front that has DOCUMENT's version and content; None where there is none.

    Raises InvalidFrontError, FrontConflictError where the version was published with other content.
    """
    content = front_file.check(document)
    stored = (
        FrontVersion.objects.released()
        .filter(application=content.application, version=str(content.version))
        .first()
    )
    if stored is not None and stored.digest != front_file.digest(document):
        raise FrontConflictError(
            f"{stored.slug} is published with other content (digest {stored.digest[:12]}...): "
            "give the changed front another version"
        )
    return stored


@transaction.atomic
def publish_content(document: dict[str, Any], by: str = COMMAND_LINE) -> tuple[FrontVersion, bool]:
    """Publish DOCUMENT at once, and whether that was new. The same content again changes nothing.

    Raises what `published` and `publish` raise.
    """
    if (stored := published(document)) is not None:
        return stored, False
    return publish(submit(create_draft(document, by), by), by), True


def publish_file(path: Path, by: str = COMMAND_LINE) -> tuple[FrontVersion, bool]:
    """Publish the front in the JSON file PATH; raises InvalidFrontError also where it is not JSON."""
    document = front_file.read(path)
    try:
        return publish_content(document, by)
    except REFUSALS as error:
        raise type(error)(f"{path}: {error}") from error


def import_file(path: Path, by: str = COMMAND_LINE) -> FrontVersion:
    """A draft of the front in the JSON file PATH. Raises what create_draft raises."""
    document = front_file.read(path)
    try:
        return create_draft(document, by, f"from the file {path.name}")
    except REFUSALS as error:
        raise type(error)(f"{path}: {error}") from error


def refuse_altered(front: selectors.Front) -> None:
    """Raise FrontConflictError where the stored content of FRONT does not fit its digest."""
    document = selectors.document(front)
    read = selectors.front_of(document)
    if front_file.digest(document) != front.digest or (read.points, read.probes) != (
        front.points,
        front.probes,
    ):
        raise FrontConflictError(
            f"{front.slug} does not fit its digest {front.digest[:12]}...: the database was changed by hand; "
            "restore it from a backup, or draft the front again"
        )


@transaction.atomic
def _move(front: FrontVersion, state: str, action: str, by: str, note: str) -> FrontVersion:
    stored = FrontVersion.objects.select_for_update().get(pk=front.pk)
    before, stored.state = stored.state, state
    if before == state:
        raise TransitionError(front.slug, before, state)
    if state == State.PUBLISHED and state in PERMITTED[before]:
        # Checks the stored row: FRONT may have been read long ago.
        second_person.require(stored, by)
        _sequence(selectors.reference(stored.sequence))
        refuse_altered(selectors.any_front(stored.pk))
    if state == State.PUBLISHED:
        stored.published_at = timezone.now()
    if state == State.RETIRED:
        stored.retired_at = timezone.now()
    stored.save()
    _log(stored, action, before, by, note)
    front.refresh_from_db()
    return front


def _configuration(
    front: FrontVersion, position: int, point: Mapping[str, Any], probe: bool
) -> Configuration:
    """A row of FRONT, not stored, from a POINT of its canonical file; its trajectory is stored."""
    values = dict(point)
    if "trajectory" in values:
        values["trajectory"] = trajectories.store(values["trajectory"])
    return Configuration(front=front, position=position, probe=probe, **values)


def _check_plans(document: Mapping[str, Any]) -> None:
    """Raise InvalidFrontError where a configuration does not fit the camera of the sequence, if that can be
    read.
    """
    kinds = {kind: document.get(kind, []) for kind in ("configurations", "probes")}
    places = [(kind, place, point) for kind in kinds for place, point in enumerate(kinds[kind])]
    for kind, place, point in places:
        try:
            plans.make(document["sequence"]["sha256"], point["parameters"])
        except ConfigurationError as error:
            member = f"{kind}[{place}].parameters of {point['name']}"
            raise front_file.InvalidFrontError(f"not a front: {member}: {error}") from error
        except sequences.SequenceError:
            return


def _sequence(wanted: Mapping[str, str]) -> dict[str, Any]:
    """The sequence that a front's file WANTED, as the manifest describes it. Raises SequenceError."""
    colour = wanted.get("colour_sha256")
    found = sequences.describe(wanted["name"], wanted["sha256"], colour is not None)
    if colour is not None and colour != (here := found["colour"]["sha256"]):
        raise sequences.SequenceError(
            f"the colour of {wanted['name']} that is here has the digest {here[:12]}..., the front was "
            f"measured on {colour[:12]}...: put the pack of that colour there"
        )
    return found


def _refuse_anothers(draft: FrontVersion, by: str) -> None:
    """Raise FrontConflictError where another person than BY made the DRAFT: drafts are not lost silently."""
    made = AuditEntry.objects.filter(subject=draft.slug, action__in=(DRAFTED, REPLACED)).first()
    if made is not None and made.actor != by:
        raise FrontConflictError(
            f"{draft.slug} is a draft of {made.actor}: give this content another version, or discard that "
            "draft first"
        )


def _log(front: FrontVersion, action: str, before: str, by: str, note: str) -> None:
    record(
        *(by, action, front.slug, note),
        front_id=None if action in (DRAFTED, REPLACED) else front.pk,
        from_state=before,
        to_state=front.state,
        digest=front.digest,
    )
