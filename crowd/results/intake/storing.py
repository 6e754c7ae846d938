"""Taking in what clients send: a request is one transaction, stored once, item by item, or not at all."""

import hashlib
import json
from dataclasses import dataclass
from typing import Any

import msgspec
from django.db import IntegrityError, transaction
from django.db.models import CharField, QuerySet, UUIDField
from django.utils import timezone

from crowd.database.prepared import Placeholder, Query, insert, insert_keyed
from crowd.devices.models import Installation
from crowd.devices.recognition import Recognised, recognise
from crowd.devices.services import bind_device, check_device, choose_disclosure, withdraw_consent
from crowd.fronts import policy
from crowd.fronts.policy import Policy
from crowd.http.problems import Problem
from crowd.results.intake import checking, packing, protocol_2, schema, unknown_members
from crowd.results.intake.allowance import Sender, charge_body, charge_rows
from crowd.results.intake.stages import STAGES
from crowd.results.models import MeasurementSession, Run, State, Submission
from slam.public_text import without_folders

CLOSED_SECONDS = 3600
TRIES = 3  # a request stored beside others of the same content


@dataclass(frozen=True)
class Acceptance:
    """The answer as JSON; whether it was sent before; the sessions that now wait for their summaries."""

    answer: str
    replayed: bool
    sessions: tuple[int, ...] = ()


def accept_submission(sender: Sender, key: str, body: bytes) -> Acceptance:
    """Store what BODY (JSON) holds, under the idempotency KEY of SENDER.

    The same key with the same body is answered as before and changes nothing. Raises Problem: 400 for what
    cannot be read, 409 for a key used with another body or another device, 422 where no run can be taken,
    426, 429, 503.
    """
    digest = hashlib.sha256(body).hexdigest()
    earlier = _earlier(sender.installation, key, digest)
    if earlier is not None:
        return earlier
    holding = policy.current()
    _refuse_unless_open(holding)
    charge_body(sender, body)
    # Decoded before the transaction: other writers need not wait for that.
    parsed = _parsed(body, holding)
    for tries in range(1, TRIES + 1):
        try:
            with transaction.atomic():
                return _accept(sender, key, digest, parsed, careful=tries > 1)
        except IntegrityError:
            # Something of it is stored already, or the installation is being erased.
            if tries == TRIES:
                raise
    raise AssertionError("the last try returns or raises")


def _accept(sender: Sender, key: str, digest: str, parsed: checking.Parsed, careful: bool) -> Acceptance:
    """One try, in one transaction. Nearly always nothing of a request is stored yet: that is only looked up
    where CAREFUL, after the database refused to store something twice.
    """
    installation = sender.installation
    if careful:
        # One request of an installation at a time, so that a run sent twice at once is stored once.
        # Summaries of it may be stored meanwhile; it may not be erased.
        known = Installation.objects.filter(pk=installation.pk, revoked_at=None)
        if not known.select_for_update(no_key=True).exists():
            raise Problem(401, "token_invalid", "this installation was erased: enrol again")
        earlier = _earlier(installation, key, digest)
        if earlier is not None:
            return earlier
    checked = checking.check(parsed, installation, look=careful)
    checked.refuse_if_all_bad()
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
    return Acceptance(submission.answer, replayed=False, sessions=_store(sender, submission, checked))


def _earlier(installation: Installation, key: str, digest: str) -> Acceptance | None:
    """The answer that the body with DIGEST got under KEY. Raises Problem 409 for another body under it."""
    for earlier_digest, answer in _answered.rows(installation=installation.pk, key=key):
        if earlier_digest != digest:
            raise Problem(
                409, "idempotency_key_reused", "this key came with another body before: use a new key"
            )
        return Acceptance(answer, replayed=True)
    return None


def _under_the_key() -> "QuerySet[Submission, tuple[str, str]]":
    rows = Submission.objects.filter(
        installation=Placeholder("installation", UUIDField()), idempotency_key=Placeholder("key", CharField())
    )
    return rows.order_by().values_list("body_sha256", "answer")


_answered = Query(_under_the_key)


def validate_submission(sender: Sender, body: bytes) -> list[dict[str, Any]]:
    """What accept_submission would answer for each run of BODY, nothing stored. Raises the same problems,
    but for a closed intake.
    """
    charge_body(sender, body)
    parsed = _parsed(body, policy.current())
    checked = checking.check(parsed, sender.installation, look=True)
    checked.refuse_if_all_bad()
    check_device(sender.installation, parsed.submission.device)
    return [item.answer() for item in checked.items]


def refuse_outdated(app_version: str, holding: Policy) -> None:
    """Raises Problem 426 for a program older than the policy's minimum, 400 for one that is not a version."""
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
    """Raises Problem 400 for consent to another version of the text."""
    if version != holding.consent_version:
        raise Problem(
            400,
            "consent_outdated",
            f"consent_version is {version}, the present text has {holding.consent_version}: ask again",
            field="consent_version",
        )


def _refuse_unless_open(holding: Policy) -> None:
    if not holding.accepting:
        text = _with(holding.message, "no measurements are accepted now: keep them")
        raise Problem(503, "not_accepting", text, retry_after=CLOSED_SECONDS)


def _with(message: str, text: str) -> str:
    """TEXT, and what the administrator says to it."""
    return f"{text} ({message})" if message else text


def _parsed(body: bytes, holding: Policy) -> checking.Parsed:
    submission = schema.submission(body)
    refuse_outdated(submission.app_version, holding)
    refuse_other_consent(submission.consent_version, holding)
    return checking.Parsed(submission, unknown_members.of_submission(body))


def _store(sender: Sender, submission: Submission, checked: checking.Intake) -> tuple[int, ...]:
    """Write SUBMISSION, its new runs and their sessions; the primary keys of the sessions that got runs."""
    new = [item for item in checked.items if item.rejection is None and not item.duplicate]
    if not new:
        charge_rows(sender, [submission], {})
        insert([submission])
        return ()
    raw = checked.submission.device
    device = recognise(raw, sender.installation.simulated)
    bind_device(sender.installation, device.description, raw, sender.network)
    if device.named_by_consent and not sender.installation.show_model:
        # Not everybody agrees any more; who measured it is counted again once it is stored.
        withdraw_consent(device.model)
    named = {item.session.id: item for item in new}
    made = {
        uuid: _session(submission, checked, item, device)
        for uuid, item in named.items()
        if uuid not in checked.sessions
    }
    sessions = {uuid: checked.sessions.get(uuid) or made[uuid] for uuid in named}
    runs = [_run(item, checked.fronts[item.session.front_version]) for item in new]
    charge_rows(sender, [submission, *made.values(), *runs], raw)
    insert([submission])
    insert_keyed(list(made.values()))
    for run, item in zip(runs, new, strict=True):
        run.session_id = sessions[item.session.id].pk
    insert(runs)
    # A session that goes on has more runs now than its summary knows, also one that is being made just now.
    if going_on := [session.pk for uuid, session in checked.sessions.items() if uuid in named]:
        MeasurementSession.objects.filter(pk__in=going_on).update(summary_algorithm=None)
    return tuple(session.pk for session in sessions.values())


def _session(
    submission: Submission, checked: checking.Intake, item: checking.Item, device: Recognised
) -> MeasurementSession:
    """A new session, that of ITEM's run."""
    session, beyond = item.session, item.beyond
    version = session.protocol_version
    known, unknown = protocol_2.columns(version, beyond.members, protocol_2.SessionMembers)
    return MeasurementSession(
        uuid=session.id,
        installation_id=submission.installation_id,
        submission_id=submission.pk,
        description_id=device.description,
        device_id=device.model,
        front_id=checked.fronts[session.front_version].row.pk,
        protocol_version=version,
        backend=session.backend,
        processor=device.processor,
        processor_class=device.processor_class,
        driver=device.driver,
        # A phone whose clock runs ahead must not be the latest for ever.
        started_at=min(session.started_at, timezone.now()),
        samples=[
            msgspec.to_builtins(sample) | more
            for sample, more in zip(session.samples, beyond.samples, strict=True)
        ],
        extra=unknown,
        **known,
    )


def _run(item: checking.Item, front: checking.Front) -> Run:
    """The row of ITEM's run, without its session. A task judges it later."""
    run = item.run
    assert run is not None  # an item without a run is rejected
    stages = run.stages_us or {}
    names, stages_us = packing.pack_stages({name: stages[name] for name in stages if name in STAGES})
    unknown_stages = {name: stages[name] for name in stages if name not in STAGES}
    known, unknown = protocol_2.columns(front.protocol.version, item.extra, protocol_2.RunMembers)
    tracked = run.tracked if isinstance(run.tracked, list) else []
    number_tracked = run.tracked if isinstance(run.tracked, int) else None
    return Run(
        uuid=run.id,
        configuration_id=front.configurations[run.configuration].pk,
        repeat=run.repeat,
        order=run.order,
        status=run.status,
        failure=without_folders(run.failure or ""),
        frame_us=packing.pack(run.frame_us),
        stages=names,
        stages_us=stages_us,
        tracked=packing.pack_tracked(tracked),
        tracked_frames=tracked.count(True) if tracked else number_tracked,
        ate_max=run.ate_max,
        ate_mean=run.ate_mean,
        ate_rmse=run.ate_rmse,
        trajectory_sha256=run.trajectory_sha256 or "",
        extra=unknown | ({"stages_us": unknown_stages} if unknown_stages else {}),
        state=State.PENDING,
        **known,
    )
