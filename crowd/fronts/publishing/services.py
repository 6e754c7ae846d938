"""Writes of fronts: draft, review, publication, retirement. Each is one transaction with a log entry."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from django.core.exceptions import ValidationError
from django.db import transaction
from django.utils import timezone
from msgspec.structs import replace
from numpy.typing import NDArray

from crowd.audit.services import COMMAND_LINE, record
from crowd.fronts import selectors, sequences, trajectories
from crowd.fronts.content import front_file, plans
from crowd.fronts.models import PERMITTED, Configuration, FrontVersion, TransitionError
from crowd.fronts.publishing import second_person
from crowd.fronts.publishing.second_person import DRAFTED, PREPARED, REPLACED, SUBMITTED
from slam.configuration import ConfigurationError
from slam.definitions import SYSTEMS
from wire.front import Content, Front, PackName

State = FrontVersion.State


class FrontConflictError(ValueError):
    """The version exists with other content; the remedy is a new version."""


REFUSALS = (
    *(front_file.InvalidFrontError, sequences.SequenceError, FrontConflictError),
    second_person.SecondPersonError,
)


def create_draft(document: Mapping[str, Any], by: str = COMMAND_LINE, note: str = "") -> FrontVersion:
    """Create a draft from `document`, a front file. An earlier draft of the version is replaced.

    Raises InvalidFrontError, SequenceError, or FrontConflictError if the version is not a draft, or is a
    draft of another person with other content.
    """
    return _draft(front_file.check_draft(document), by, note)


@transaction.atomic
def _draft(content: Content, by: str, note: str) -> FrontVersion:
    slug = content.slug
    front = FrontVersion.objects.select_for_update().filter(slug=slug).first()
    if front is not None and front.state != State.DRAFT:
        raise FrontConflictError(f"{slug} is {front.get_state_display()}: give this content another version")
    digest = front_file.digest(content)
    if front is not None and front.digest != digest:
        _refuse_draft_of_another(front, by)
    action = DRAFTED if front is None else REPLACED
    if front is None:
        front = FrontVersion(
            slug=slug, application=content.application, version=content.version, state=State.DRAFT
        )
    _store_content(front, content)
    _log(front, action, "", by, note)
    return front


@transaction.atomic
def complete_draft(front: FrontVersion, digest: str, document: dict[str, Any]) -> FrontVersion:
    """Replace the content of the draft `front`, whose digest was `digest`, by `document`, which is prepared.

    Its author stays who drafted it. Raises InvalidFrontError and SequenceError, and FrontConflictError if the
    draft has changed.
    """
    stored = FrontVersion.objects.select_for_update().get(pk=front.pk)
    if stored.state != State.DRAFT or stored.digest != digest:
        raise FrontConflictError(f"{stored.slug} has changed since its preparation began: prepare it again")
    _store_content(stored, front_file.check(document))
    _log(stored, PREPARED, "", second_person.last_author(stored), "")
    return stored


@transaction.atomic
def draft_again(front: FrontVersion, by: str = COMMAND_LINE) -> FrontVersion:
    """A draft of the next version with the points of `front`, to be prepared with this program.

    Raises the errors of `create_draft`.
    """
    content = front_file.without_preparation(selectors.content(selectors.front_in_any_state(front.pk)))
    content = replace(content, version=selectors.next_version(front.application))
    return _draft(content, by, f"the points of {front.slug}, to be prepared again")


@transaction.atomic
def discard(front: FrontVersion, by: str = COMMAND_LINE) -> None:
    """Delete a draft that was never in review. Raises ValidationError otherwise."""
    if front.audit.exists():
        raise ValidationError(f"{front.slug} was in review and is kept: correct it with a new draft")
    record(by, "discarded", front.slug, from_state=front.state, digest=front.digest)
    front.delete()
    trajectories.delete_unused()


def submit(front: FrontVersion, by: str = COMMAND_LINE, note: str = "") -> FrontVersion:
    """Submit a draft for review, which fixes its content.

    Raises TransitionError, and InvalidFrontError if it is not prepared with this program.
    """
    _check_prepared(selectors.front_in_any_state(front.pk))
    return _transition(front, State.IN_REVIEW, SUBMITTED, by, note)


def send_back(front: FrontVersion, by: str = COMMAND_LINE, note: str = "") -> FrontVersion:
    """Turn a front in review into a draft again. Raises TransitionError."""
    return _transition(front, State.DRAFT, "sent back", by, note)


def publish(front: FrontVersion, by: str = COMMAND_LINE, note: str = "") -> FrontVersion:
    """Publish a front in review, so that clients measure it. This cannot be undone.

    Raises TransitionError; SequenceError if its sequence is missing or damaged; FrontConflictError if its
    content does not match its digest; SecondPersonError if `by` is one of its authors and a second person is
    required.
    """
    return _transition(front, State.PUBLISHED, "published", by, note)


def retire(front: FrontVersion, by: str = COMMAND_LINE, note: str = "") -> FrontVersion:
    """Stop clients from measuring `front`. Its results stay, and late ones are accepted.

    Raises TransitionError if it is not published; SecondPersonError as `second_person.check_retirement`.
    """
    if front.state == State.PUBLISHED:
        second_person.check_retirement(front, by)
    return _transition(front, State.RETIRED, "retired", by, note)


@transaction.atomic
def publish_again(front: FrontVersion, by: str = COMMAND_LINE) -> FrontVersion:
    """Roll back: publish the content of an earlier `front` as the next version.

    If a second person is required, the new version stays in review. Raises TransitionError if `front` was
    never published, and the errors of `publish`.
    """
    if front.state not in (State.PUBLISHED, State.RETIRED):
        raise TransitionError(front.slug, front.state, "published again")
    content = selectors.content(selectors.front_in_any_state(front.pk))
    content = replace(
        content,
        version=selectors.next_version(front.application),
        provenance=content.provenance | {"published_again_from": front.slug},
    )
    note = f"the content of {front.slug} again"
    again = submit(_draft(content, by, note), by, note)
    return again if second_person.is_required() else publish(again, by, note)


def is_prepared(front: FrontVersion) -> bool:
    """Whether `front` has what clients need of it."""
    try:
        _check_prepared(selectors.front_in_any_state(front.pk))
    except front_file.InvalidFrontError:
        return False
    return True


def _check_prepared(front: Front) -> None:
    """Raise InvalidFrontError if `front` lacks what clients need, or was prepared with another program."""
    front_file.check(front_file.document(selectors.content(front)))
    if outdated := plans.outdated(front):
        raise front_file.InvalidFrontError(
            f"{front.slug} was prepared with another version of the program, which computes "
            f"{', '.join(outdated)} differently: prepare it again"
        )


def published(document: dict[str, Any]) -> FrontVersion | None:
    """The released front with the version and content of `document`, or None.

    Raises InvalidFrontError, and FrontConflictError if the version was published with other content.
    """
    content = front_file.check(document)
    stored = FrontVersion.objects.released().filter(slug=content.slug).first()
    if stored is not None and stored.digest != front_file.digest(content):
        raise FrontConflictError(
            f"{stored.slug} is published with other content (digest {stored.digest[:12]}...): "
            "give the changed front another version"
        )
    return stored


@transaction.atomic
def publish_content(document: dict[str, Any], by: str = COMMAND_LINE) -> tuple[FrontVersion, bool]:
    """Publish `document`. Returns the front, and whether it is new; existing content changes nothing.

    Raises the errors of `published` and `publish`.
    """
    if (stored := published(document)) is not None:
        return stored, False
    return publish(submit(create_draft(document, by), by), by), True


def import_file(path: Path, by: str = COMMAND_LINE) -> FrontVersion:
    """Create a draft from the JSON file `path`. Raises the errors of `create_draft`."""
    document = front_file.read(path)
    try:
        return create_draft(document, by, f"from the file {path.name}")
    except REFUSALS as error:
        raise type(error)(f"{path}: {error}") from error


def check_digest(front: Front) -> None:
    """Raise FrontConflictError if the stored content of `front` does not match its digest."""
    rows = Configuration.objects.filter(front__slug=front.slug)
    stored = list(rows.values_list("name", "probe", "skipped", "trajectory"))
    meant = [
        (point.name, place >= len(front.points), point.skipped, point.trajectory_sha256)
        for place, point in enumerate(front.content.every)
    ]
    if front_file.digest(selectors.content(front)) != front.digest or stored != meant:
        raise FrontConflictError(
            f"{front.slug} does not match its digest {front.digest[:12]}: the database was changed by hand: "
            "restore it from a backup, or draft the front again"
        )


@transaction.atomic
def _transition(front: FrontVersion, state: str, action: str, by: str, note: str) -> FrontVersion:
    stored = FrontVersion.objects.select_for_update().get(pk=front.pk)
    before, stored.state = stored.state, state
    if before == state:
        raise TransitionError(front.slug, before, state)
    if state == State.PUBLISHED and state in PERMITTED[before]:
        # Check the stored row, because FRONT may be outdated.
        second_person.check(stored, by)
        checked = selectors.read(stored)
        _sequence(checked.content.sequence)
        check_digest(checked)
        _check_prepared(checked)
    if state == State.PUBLISHED:
        stored.published_at = timezone.now()
    if state == State.RETIRED:
        stored.retired_at = timezone.now()
    stored.save()
    _log(stored, action, before, by, note)
    front.refresh_from_db()
    return front


def _store_content(front: FrontVersion, content: Content) -> None:
    """Store `content`, of a file, as that of the draft `front`.

    Raises SequenceError, and InvalidFrontError if the sequence has fewer frames than the protocol or a
    configuration does not fit its camera.
    """
    sequence, frames = _sequence(content.sequence), content.protocol.frames
    if frames > sequence["frames"]:
        raise front_file.InvalidFrontError(
            f"not a front: protocol.frames: {frames}, but {sequence['name']} has only {sequence['frames']}"
        )
    if plans.has_plans(front.application):
        _check_plans(content)
    front.digest = front_file.digest(content)
    front.sequence = sequence
    truth = _first_truth(content)
    stored = content.with_each(lambda point: trajectories.named(point, truth))
    front.document = msgspec.json.encode(stored).decode()
    front.save()
    front.configurations.all().delete()
    Configuration.objects.bulk_create(
        Configuration(
            front=front,
            name=point.name,
            position=position,
            probe=position >= len(content.configurations),
            skipped=point.skipped,
            trajectory=None if point.trajectory is None else trajectories.store(point.trajectory),
        )
        for position, point in enumerate(content.every)
    )
    trajectories.delete_unused()


def _check_plans(content: Content) -> None:
    """Raise InvalidFrontError if a configuration does not fit the camera of the sequence.

    Not checked if the sequence cannot be read.
    """
    for kind in front_file.KINDS:
        for number, point in enumerate(getattr(content, kind)):
            try:
                plans.make(content.sequence.sha256, point.parameters)
            except ConfigurationError as error:
                member = f"{kind}[{number}].parameters of {point.name}"
                raise front_file.InvalidFrontError(f"not a front: {member}: {error}") from error
            except sequences.SequenceError:
                return


def _first_truth(content: Content) -> NDArray[np.float64] | None:
    """The true poses (frames, 4, 4) of the frames that clients measure.

    None if the sequence has none or cannot be read, or if the system may move its first pose later, so that
    a reference's errors do not bind those of a run.
    """
    system = SYSTEMS.get(content.application)
    if system is None or system.revises:
        return None
    try:
        truth = sequences.open_pack(content.sequence.sha256).truth
    except sequences.SequenceError:
        return None
    return None if truth is None else truth[: content.protocol.frames]


def _sequence(wanted: PackName) -> dict[str, Any]:
    """The description of the sequence that a front file names. Raises SequenceError."""
    colour = wanted.colour_sha256
    description = sequences.find_verified(wanted.name, wanted.sha256, colour is not None)
    if colour is not None and colour != (here := description["colour"]["sha256"]):
        raise sequences.SequenceError(
            f"the installed colour of {wanted.name} has the digest {here[:12]}..., the front was "
            f"measured on {colour[:12]}...: install the pack of that colour"
        )
    return description


def _refuse_draft_of_another(draft: FrontVersion, by: str) -> None:
    """Raise FrontConflictError if another person than `by` made `draft`, so that no draft is lost
    silently."""
    author = second_person.last_author(draft)
    if author != by:
        raise FrontConflictError(
            f"{draft.slug} is a draft of {author}: give this content another version, or discard that "
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
