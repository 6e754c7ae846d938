"""Decides which runs of a submission are accepted, before anything is stored."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from datetime import UTC
from typing import Any
from uuid import UUID

from crowd.devices.models import Installation
from crowd.fronts.models import Configuration, FrontVersion
from crowd.http.codes import REJECTED_RUNS
from crowd.http.problems import Problem
from crowd.results.intake import checks, schema, unknown_members
from crowd.results.intake.checks import Rejection
from crowd.results.models import MeasurementSession, Run
from wire import session as declared
from wire.front import Errors, Protocol
from wire.protocol import MOST_RUNS, VERSION

# Fronts by slug. A released front never changes, is never deleted, and keeps accepting measurements.
_released_fronts: dict[str, "Front"] = {}

ACCEPTED, DUPLICATE, REJECTED = "accepted", "duplicate", "rejected"


@dataclass(frozen=True)
class Front:
    """What runs are checked against: a released front."""

    row: FrontVersion
    protocol: Protocol
    configurations: dict[str, Configuration]
    reference_ate: dict[str, Errors | None]


@dataclass
class Item:
    """One run of a submission: rejected, a duplicate, or new."""

    id: str | None
    session: schema.Session
    extras: unknown_members.SessionExtras
    run: declared.Run | None = None
    extra: dict[str, Any] = field(default_factory=dict)
    rejection: Rejection | None = None
    duplicate: bool = False

    def answer(self) -> dict[str, Any]:
        """The item of the response to the client."""
        if self.rejection is not None:
            return {
                "id": self.id,
                "status": REJECTED,
                "code": self.rejection.code,
                "field": self.rejection.field,
                "detail": self.rejection.detail,
            }
        return {"id": self.id, "status": DUPLICATE if self.duplicate else ACCEPTED, "code": None}


@dataclass(frozen=True)
class ParsedSubmission:
    """A decoded submission with its unknown members."""

    submission: schema.Submission
    extras: unknown_members.Extras


@dataclass(frozen=True)
class CheckedSubmission:
    """A checked submission: its runs in order, and the fronts and stored sessions that they name."""

    submission: schema.Submission
    extras: unknown_members.Extras
    fronts: dict[str, Front]
    sessions: dict[UUID, MeasurementSession]
    items: list[Item]

    def refuse_if_all_bad(self) -> None:
        """Raises Problem 422 if all runs are rejected. A code that all share is the code of the problem."""
        rejections = [item.rejection for item in self.items if item.rejection is not None]
        if len(rejections) < len(self.items):
            return
        first, answers = rejections[0], [item.answer() for item in self.items]
        if len({rejection.code for rejection in rejections}) == 1:
            raise Problem(first.code, first.detail, status=REJECTED_RUNS, field=first.field, items=answers)
        raise Problem("all_runs_rejected", "no run was accepted: each item says why", items=answers)


def check_submission(
    parsed: ParsedSubmission, installation: Installation, look_up: bool
) -> CheckedSubmission:
    """Decide on each run of `parsed`, which `installation` sent.

    `look_up`: find out, in two or three queries, which sessions and runs are already stored. Otherwise all
    are assumed to be new, and the database refuses to store one twice.

    Raises Problem if the whole request is refused: for the description of the device or the number of runs.
    """
    submission, extras = parsed.submission, parsed.extras
    checks.check_device(submission.device)
    count = sum(len(session.runs) for session in submission.sessions)
    if not 1 <= count <= MOST_RUNS:
        raise Problem("run_count", f"{count} runs: send 1 to {MOST_RUNS}", field="sessions")
    fronts = _read_fronts({session.front_version for session in submission.sessions})
    sessions = _stored_sessions(submission) if look_up else {}
    cores = checks.claimed_cores(submission.device)
    items: list[Item] = []
    first: dict[UUID, schema.Session] = {}
    for index, session in enumerate(submission.sessions):
        front = fronts.get(session.front_version)
        stored = sessions.get(session.id)
        refusal = _check_session(session, front, stored, first.get(session.id), installation)
        if refusal is None:
            earlier = stored or first.get(session.id)
            shared = {name: getattr(earlier, name) for name in checks.SAME_IN_ALL_PARTS} if earlier else None
            refusal = checks.check_conditions(session, shared)
        session_items = list(_session_items(index, session, extras.sessions[index], front, refusal, cores))
        if refusal is None:
            refusal = checks.check_samples(session.samples, [item.run for item in session_items if item.run])
            _reject_all(session_items, refusal, f"sessions[{index}]")
        if refusal is None:
            first.setdefault(session.id, session)
        items += session_items
    _mark_duplicates(items, _stored_runs(items) if look_up else set())
    _refuse_taken_repeats(items, sessions)
    return CheckedSubmission(submission, extras, fronts, sessions, items)


def _read_fronts(slugs: set[str]) -> dict[str, Front]:
    """The released fronts among `slugs`. Fronts that this process has read need no query."""
    if missing := slugs - _released_fronts.keys():
        rows = FrontVersion.objects.released().filter(slug__in=missing).prefetch_related("configurations")
        for row in rows:
            configurations = {configuration.name: configuration for configuration in row.configurations.all()}
            content = row.content
            reference_ate = {point.name: point.reference_ate for point in content.every}
            _released_fronts[row.slug] = Front(row, content.protocol, configurations, reference_ate)
    return {slug: _released_fronts[slug] for slug in slugs & _released_fronts.keys()}


def _session_items(
    index: int,
    session: schema.Session,
    extras: unknown_members.SessionExtras,
    front: Front | None,
    refusal: Rejection | None,
    cores: int | None,
) -> Iterator[Item]:
    for number, raw in enumerate(session.runs):
        item = Item(schema.decode_id(raw), session, extras, rejection=refusal)
        where = f"sessions[{index}]"
        if refusal is None and front is not None:
            where = f"{where}.runs[{number}]"
            try:
                item.run = schema.decode_run(raw)
                item.extra = unknown_members.extras_of_run(raw)
                item.rejection = checks.check_run(
                    item.run, front.reference_ate, front.protocol, session.stage_clock, cores
                )
            except Problem as problem:
                item.rejection = Rejection(problem.code, problem.detail, problem.field)
        if item.rejection is not None:
            member = item.rejection.field
            item.rejection = replace(item.rejection, field=f"{where}.{member}" if member else where)
        yield item


def _reject_all(items: list[Item], refusal: Rejection | None, where: str) -> None:
    """Reject those `items` that are not rejected yet, for a `refusal` of their session, whose path is
    `where`."""
    if refusal is None:
        return
    for item in items:
        item.rejection = item.rejection or replace(refusal, field=f"{where}.{refusal.field}")


def _check_session(
    session: schema.Session,
    front: Front | None,
    stored: MeasurementSession | None,
    first: schema.Session | None,
    installation: Installation,
) -> Rejection | None:
    """Why `session` is rejected, or None.

    `stored`: its stored part. `first`: its first part in this request.
    """
    if front is None or front.row.application != session.application:
        return Rejection(
            "unknown_front_version",
            f"no front {session.front_version!r} of {session.application!r} is published here",
            "front_version",
        )
    if not session.protocol_version == front.protocol.version == VERSION:
        return Rejection(
            "unknown_protocol_version",
            f"this server takes sessions of protocol {VERSION}: measure the front that the manifest names",
            "protocol_version",
        )
    try:
        session.started_at.astimezone(UTC)
    except OverflowError:
        return Rejection("invalid_field", f"{session.started_at} has no time in UTC", "started_at")
    # Runs of one session are compared with each other: they need the same front and backend.
    present = installation.pk, front.row.pk, session.backend
    taken = stored is not None and (stored.installation_id, stored.front_id, stored.backend) != present
    other = first is not None and (first.front_version, first.backend) != (
        session.front_version,
        session.backend,
    )
    if taken or other:
        return Rejection("session_taken", "another session has this id: use a new one", "id")
    return None


def _stored_sessions(submission: schema.Submission) -> dict[UUID, MeasurementSession]:
    rows = MeasurementSession.objects.filter(uuid__in=[session.id for session in submission.sessions])
    return {row.uuid: row for row in rows}


def _stored_runs(items: list[Item]) -> set[UUID]:
    ids = [item.run.id for item in items if item.run is not None]
    return set(Run.objects.filter(uuid__in=ids).values_list("uuid", flat=True))


def _mark_duplicates(items: list[Item], seen: set[UUID]) -> None:
    """Mark runs as duplicates whose id was `seen`: stored, or earlier in this request."""
    for item in items:
        if item.run is not None and item.rejection is None:
            item.duplicate = item.run.id in seen
            seen.add(item.run.id)


def _refuse_taken_repeats(items: list[Item], sessions: dict[UUID, MeasurementSession]) -> None:
    """Reject runs whose repeat of a configuration exists in their session under another id."""
    taken: set[tuple[UUID, str, int]] = set()
    if sessions:  # usually none is stored yet
        stored = Run.objects.filter(session__in=sessions.values())
        taken.update(stored.values_list("session__uuid", "configuration__name", "repeat"))
    for item in items:
        if item.run is None or item.rejection is not None or item.duplicate:
            continue
        key = (item.session.id, item.run.configuration, item.run.repeat)
        if key in taken:
            detail = (
                f"repeat {item.run.repeat} of {item.run.configuration} is stored already, under another id"
            )
            item.rejection = Rejection("repeat_taken", detail)
        taken.add(key)
