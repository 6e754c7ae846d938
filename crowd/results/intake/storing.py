"""Taking in what clients send: a request is one transaction, stored once, item by item, or not at all."""

import hashlib
import json
from dataclasses import dataclass
from typing import Any

import msgspec
from django.db import IntegrityError, transaction
from django.db.models import CharField, QuerySet, UUIDField
from django.utils import timezone

from crowd.devices.models import Installation
from crowd.devices.recognition import Recognised, recognise
from crowd.devices.services import choose_disclosure, withdraw_consent
from crowd.disclosure import public
from crowd.fronts import policy
from crowd.fronts.policy import Policy
from crowd.prepared import Placeholder, Query, insert, insert_keyed
from crowd.problems import Problem
from crowd.results.intake import checking, packing, schema, unknown_members
from crowd.results.models import MeasurementSession, Run, Submission
from crowd.results.validity import runs

CLOSED_SECONDS = 3600
TRIES = 3  # a request stored beside others of the same content


@dataclass(frozen=True)
class Acceptance:
    """What the client is told, as JSON; whether it was told before; the sessions that now wait."""

    answer: str
    replayed: bool
    sessions: tuple[int, ...] = ()


def accept_submission(installation: Installation, key: str, body: bytes) -> Acceptance:
    """Store what BODY (JSON) holds, under the idempotency KEY of INSTALLATION.

    The same key with the same body answers as before and changes nothing. Raises Problem: 400 for what
    cannot be read, 409 for a key used with another body, 422 where no run can be taken, 426, 429, 503.
    """
    for tries in range(1, TRIES + 1):
        try:
            with transaction.atomic():
                return _accept(installation, key, body, careful=tries > 1)
        except IntegrityError:
            # Something of it is stored already, or the installation is being erased.
            if tries == TRIES:
                raise
    raise AssertionError("the last try returns or raises")


def _accept(installation: Installation, key: str, body: bytes, careful: bool) -> Acceptance:
    """One try, in one transaction. Nearly always nothing of a request is stored yet: that is only looked up
    where CAREFUL, after the database refused to store something twice.
    """
    if careful:
        # One request of an installation at a time, so that a run sent twice at once is stored once.
        # Summaries of it may be stored meanwhile; it may not be erased.
        known = Installation.objects.filter(pk=installation.pk, revoked_at=None)
        if not known.select_for_update(no_key=True).exists():
            raise Problem(401, "token_invalid", "this installation was erased: enrol again")
    digest = hashlib.sha256(body).hexdigest()
    for earlier_digest, answer in _earlier.rows(installation=installation.pk, key=key):
        if earlier_digest != digest:
            raise Problem(
                409, "idempotency_key_reused", "this key came with another body before: use a new key"
            )
        return Acceptance(answer, replayed=True)
    holding = policy.current()
    _refuse_unless_open(holding)
    checked = _checked(installation, body, holding, look=careful)
    choose_disclosure(installation, checked.submission.show_model)
    submission = Submission(
        installation=installation,
        idempotency_key=key,
        body_sha256=digest,
        schema_version=checked.submission.schema_version,
        app_version=checked.submission.app_version,
        consent_version=checked.submission.consent_version,
        extra=checked.extras.members,
    )
    items = [item.answer() for item in checked.items]
    submission.answer = json.dumps({"submission_id": str(submission.pk), "items": items})
    insert([submission])
    return Acceptance(submission.answer, replayed=False, sessions=_store(submission, checked))


def _under_the_key() -> "QuerySet[Submission, tuple[str, str]]":
    rows = Submission.objects.filter(
        installation=Placeholder("installation", UUIDField()), idempotency_key=Placeholder("key", CharField())
    )
    return rows.order_by().values_list("body_sha256", "answer")


_earlier = Query(_under_the_key)


def validate_submission(installation: Installation, body: bytes) -> list[dict[str, Any]]:
    """What accept_submission would answer for each run of BODY, nothing stored. Raises the same problems."""
    return [item.answer() for item in _checked(installation, body, policy.current(), look=True).items]


def refuse_outdated(app_version: str, holding: Policy) -> None:
    """Raises Problem 426 for a program older than the policy's minimum, 400 for a version that is none."""
    try:
        outdated = holding.outdates(app_version)
    except ValueError:
        raise Problem(
            400, "invalid_field", f"app_version {app_version!r}: write numbers, as 1.2.0", field="app_version"
        ) from None
    if outdated:
        minimum = holding.minimum_app_version
        text = f"version {app_version} is too old: {minimum} or newer is needed"
        raise Problem(426, "app_outdated", _with(holding.message, text), minimum_app_version=minimum)


def refuse_other_consent(version: int, holding: Policy) -> None:
    """Raises Problem 400 for a consent to another text than the present one."""
    if version != holding.consent_version:
        raise Problem(
            400,
            "consent_outdated",
            f"consent_version {version} is not the present one, {holding.consent_version}: ask again",
            field="consent_version",
        )


def _refuse_unless_open(holding: Policy) -> None:
    if not holding.accepting:
        text = _with(holding.message, "no measurements are taken at present: keep them")
        raise Problem(503, "not_accepting", text, retry_after=CLOSED_SECONDS)


def _with(message: str, text: str) -> str:
    """TEXT, and what the administrator says to it."""
    return f"{text} ({message})" if message else text


def _checked(installation: Installation, body: bytes, holding: Policy, look: bool) -> checking.Intake:
    submission = schema.submission(body)
    refuse_outdated(submission.app_version, holding)
    refuse_other_consent(submission.consent_version, holding)
    checked = checking.check(submission, unknown_members.of_submission(body), installation, look)
    checked.refuse_if_all_bad()
    return checked


def _store(submission: Submission, checked: checking.Intake) -> tuple[int, ...]:
    """Write the new runs and their sessions; the primary keys of the sessions that got runs."""
    new = [item for item in checked.items if item.rejection is None and not item.duplicate]
    if not new:
        return ()
    device = recognise(checked.submission.device, submission.installation.simulated)
    if device.named_by_consent and not submission.installation.show_model:
        # Not everybody agrees any more; who measured it is counted again once it is stored.
        withdraw_consent(device.model)
    named = {item.session.id: item for item in new}
    made = [
        _session(submission, checked, item, device)
        for uuid, item in named.items()
        if uuid not in checked.sessions
    ]
    insert_keyed(made)
    sessions = {
        session.uuid: session for session in (*checked.sessions.values(), *made) if session.uuid in named
    }
    insert(
        [_row(item, sessions[item.session.id], checked.fronts[item.session.front_version]) for item in new]
    )
    # A session that goes on has more runs now than its summary knows, also one that is being made just now.
    if going_on := [session.pk for uuid, session in checked.sessions.items() if uuid in named]:
        MeasurementSession.objects.filter(pk__in=going_on).update(summary_algorithm=None)
    return tuple(session.pk for session in sessions.values())


def _session(
    submission: Submission, checked: checking.Intake, item: checking.Item, device: Recognised
) -> MeasurementSession:
    """A new session, that of ITEM's run."""
    session, beyond = item.session, item.beyond
    return MeasurementSession(
        uuid=session.id,
        installation_id=submission.installation_id,
        submission_id=submission.pk,
        description_id=device.description,
        device_id=device.model,
        front_id=checked.fronts[session.front_version].row.pk,
        protocol_version=session.protocol_version,
        backend=session.backend,
        processor=device.processor,
        processor_class=device.processor_class,
        driver=device.driver,
        # A phone whose clock runs ahead must not be the latest for ever.
        started_at=min(session.started_at, timezone.now()),
        samples=[
            msgspec.structs.asdict(sample) | more
            for sample, more in zip(session.samples, beyond.samples, strict=True)
        ],
        extra=beyond.members,
    )


def _row(item: checking.Item, session: MeasurementSession, front: checking.Front) -> Run:
    run = item.run
    assert run is not None  # an item without a run is rejected
    names, stages_us = packing.pack_stages(run.stages_us or {})
    tracked = run.tracked if isinstance(run.tracked, list) else []
    row = Run(
        uuid=run.id,
        session_id=session.pk,
        configuration_id=front.configurations[run.configuration].pk,
        repeat=run.repeat,
        order=run.order,
        status=run.status,
        failure=public(run.failure or ""),
        frame_us=packing.pack(run.frame_us),
        stages=names,
        stages_us=stages_us,
        tracked=packing.pack_tracked(tracked),
        tracked_frames=tracked.count(True)
        if tracked
        else run.tracked
        if isinstance(run.tracked, int)
        else None,
        ate_max=run.ate_max,
        ate_mean=run.ate_mean,
        ate_rmse=run.ate_rmse,
        trajectory_sha256=run.trajectory_sha256 or "",
        extra=item.extra,
    )
    runs.judge(row, front.protocol)
    return row
