"""Stores submissions. A request is one transaction: all its accepted runs are stored, once, or none."""

import hashlib
import json
from dataclasses import dataclass

import msgspec
from django.db import IntegrityError, transaction
from django.db.models import CharField, QuerySet, UUIDField
from django.utils import timezone

from crowd.database.prepared import CompiledQuery, Placeholder, insert, insert_for, insert_keyed
from crowd.devices.models import Installation
from crowd.devices.recognition import RecognisedDevice, recognise
from crowd.devices.services import bind_device, check_device, choose_disclosure, withdraw_consent
from crowd.fronts import intake_policy
from crowd.fronts.intake_policy import Policy
from crowd.http.problems import Problem
from crowd.records.record import columns_of, values_of
from crowd.results.intake import admission, packing, schema, unknown_members
from crowd.results.intake.daily_limits import Sender, count_body, count_rows
from crowd.results.intake.stages import STAGES
from crowd.results.models import MeasurementSession, Run, RunFrames, State, Submission
from slam.public_text import without_folders
from wire import session as wire_session

RETRY_SECONDS = 3600
MAX_TRIES = 3  # while other requests store the same runs
SESSION_COLUMNS = columns_of(MeasurementSession, wire_session.Session)
RUN_COLUMNS = columns_of(Run, wire_session.Run)


@dataclass(frozen=True)
class Acceptance:
    """The response as JSON, whether it is a replay, and the sessions that now wait for their summaries."""

    answer: str
    replayed: bool
    sessions: tuple[int, ...] = ()


def accept_submission(sender: Sender, key: str, body: bytes) -> Acceptance:
    """Store the runs of `body` (JSON) under the idempotency `key` of `sender`.

    The same key with the same body gets the same response and changes nothing. Raises Problem: 400 for
    invalid content, 409 for a key used with another body or another device, 422 if all runs are rejected,
    426, 429, 503.
    """
    digest = hashlib.sha256(body).hexdigest()
    earlier = _earlier_answer(sender.installation, key, digest)
    if earlier is not None:
        return earlier
    current = intake_policy.current()
    _refuse_if_closed(current)
    count_body(sender, body)
    # Decoded before the transaction, so that other writers do not wait for it.
    parsed = _parse(body, current)
    for tries in range(1, MAX_TRIES + 1):
        try:
            with transaction.atomic():
                return _accept(sender, key, digest, parsed, careful=tries > 1)
        except IntegrityError:
            # Part of it is already stored, or the installation is being erased.
            if tries == MAX_TRIES:
                raise
    raise AssertionError("the last try returns or raises")


def _accept(
    sender: Sender, key: str, digest: str, parsed: admission.ParsedSubmission, careful: bool
) -> Acceptance:
    """One try, in one transaction.

    Usually nothing of a request is stored yet. `careful` looks that up, after the database refused a
    duplicate.
    """
    installation = sender.installation
    if careful:
        # One request of an installation at a time, so that a run that is sent twice at once is stored once.
        # The lock allows summaries of the installation to be stored, but not its erasure.
        active = Installation.objects.filter(pk=installation.pk, revoked_at=None)
        if not active.select_for_update(no_key=True).exists():
            raise Problem("token_invalid", "this installation was erased: enrol again")
        earlier = _earlier_answer(installation, key, digest)
        if earlier is not None:
            return earlier
    checked = admission.check_submission(parsed, installation, look_up=careful)
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


def _earlier_answer(installation: Installation, key: str, digest: str) -> Acceptance | None:
    """The response to an earlier request with `key` and `digest`. Raises Problem 409 for another digest."""
    for earlier_digest, answer in _answer_query.rows(installation=installation.pk, key=key):
        if earlier_digest != digest:
            raise Problem("idempotency_key_reused", "this key came with another body before: use a new key")
        return Acceptance(answer, replayed=True)
    return None


def _submissions_by_key() -> "QuerySet[Submission, tuple[str, str]]":
    rows = Submission.objects.filter(
        installation=Placeholder("installation", UUIDField()), idempotency_key=Placeholder("key", CharField())
    )
    return rows.order_by().values_list("body_sha256", "answer")


_answer_query = CompiledQuery(_submissions_by_key)


def validate_submission(sender: Sender, body: bytes) -> admission.CheckedSubmission:
    """What accept_submission would decide on each run of `body`. Nothing is stored.

    Raises the same problems, except that of a closed intake.
    """
    count_body(sender, body)
    parsed = _parse(body, intake_policy.current())
    checked = admission.check_submission(parsed, sender.installation, look_up=True)
    checked.refuse_if_all_bad()
    check_device(sender.installation, parsed.submission.device)
    return checked


def refuse_outdated(app_version: str, current: Policy) -> None:
    """Raises Problem 426 for a version below the minimum of the `current` policy, 400 for an invalid one."""
    try:
        outdated = current.is_outdated(app_version)
    except ValueError:
        raise Problem(
            "invalid_field", f"app_version {app_version!r}: write numbers, as 1.2.0", field="app_version"
        ) from None
    if outdated:
        minimum = current.minimum_app_version
        text = f"version {app_version} is too old: {minimum} or newer is needed"
        raise Problem("app_outdated", _with_message(current.message, text), minimum_app_version=minimum)


def refuse_other_consent(version: int, current: Policy) -> None:
    """Raises Problem 400 for consent to another version of the text than that of the `current` policy."""
    if version != current.consent_version:
        raise Problem(
            "consent_outdated",
            f"consent_version is {version}, the current text has {current.consent_version}: ask again",
            field="consent_version",
        )


def _refuse_if_closed(current: Policy) -> None:
    if not current.accepting:
        text = _with_message(current.message, "measurements are not accepted now: keep them and try later")
        raise Problem("not_accepting", text, retry_after=RETRY_SECONDS)


def _with_message(message: str, text: str) -> str:
    """`text` with the `message` of the administrator."""
    return f"{text} ({message})" if message else text


def _parse(body: bytes, current: Policy) -> admission.ParsedSubmission:
    submission = schema.decode_submission(body)
    refuse_outdated(submission.app_version, current)
    refuse_other_consent(submission.consent_version, current)
    return admission.ParsedSubmission(submission, unknown_members.extras_of_submission(body))


def _store(sender: Sender, submission: Submission, checked: admission.CheckedSubmission) -> tuple[int, ...]:
    """Store `submission`, its new runs and their sessions. Returns the keys of the sessions that got runs."""
    new = [item for item in checked.items if item.rejection is None and not item.duplicate]
    if not new:
        count_rows(sender, [submission], {})
        insert([submission])
        return ()
    raw = checked.submission.device
    device = recognise(raw)
    bind_device(sender.installation, device.description, raw, sender.network)
    if device.named_by_consent and not sender.installation.show_model:
        # Not all installations agree now. The task that summarises the session counts them again.
        withdraw_consent(device.model)
    named = {item.session.id: item for item in new}
    made = {
        uuid: _session_row(submission, checked, item, device)
        for uuid, item in named.items()
        if uuid not in checked.sessions
    }
    sessions = {uuid: checked.sessions.get(uuid) or made[uuid] for uuid in named}
    runs = [run_row(item, checked.fronts[item.session.front_version]) for item in new]
    frames = [frames_row(item, run) for item, run in zip(new, runs, strict=True)]
    count_rows(sender, [submission, *made.values(), *runs, *frames], raw)
    insert([submission])
    insert_keyed(list(made.values()))
    for run, item in zip(runs, new, strict=True):
        run.session_id = sessions[item.session.id].pk
    insert(runs)
    insert_for(frames, "run", "uuid")
    # The summary of a continued session is outdated, even one that is being computed now.
    if continued := [session.pk for uuid, session in checked.sessions.items() if uuid in named]:
        MeasurementSession.objects.filter(pk__in=continued).update(summary_algorithm=None)
    return tuple(session.pk for session in sessions.values())


def _session_row(
    submission: Submission,
    checked: admission.CheckedSubmission,
    item: admission.Item,
    device: RecognisedDevice,
) -> MeasurementSession:
    """A new session, from `item`."""
    session, extras = item.session, item.extras
    processor, processor_class = device.computed_by(session.backend)
    return MeasurementSession(
        **values_of(
            session,
            SESSION_COLUMNS,
            uuid=session.id,
            installation_id=submission.installation_id,
            submission_id=submission.pk,
            description_id=device.description,
            device_id=device.model,
            front_id=checked.fronts[session.front_version].row.pk,
            processor=processor,
            processor_class=processor_class,
            driver=device.driver,
            # A device whose clock runs ahead must not stay the newest.
            started_at=min(session.started_at, timezone.now()),
            samples=[
                msgspec.to_builtins(sample) | more
                for sample, more in zip(session.samples, extras.samples, strict=True)
            ],
            extra=extras.members,
        )
    )


def run_row(item: admission.Item, front: admission.Front) -> Run:
    """The run of `item`, without its session. A task judges it later."""
    run = item.run
    assert run is not None  # an item without a run is rejected
    unknown_stages = {name: each for name, each in (run.stages_us or {}).items() if name not in STAGES}
    tracked = run.tracked if isinstance(run.tracked, list) else []
    number_tracked = run.tracked if isinstance(run.tracked, int) else None
    return Run(
        **values_of(
            run,
            RUN_COLUMNS,
            uuid=run.id,
            configuration_id=front.configurations[run.configuration].pk,
            failure=without_folders(run.failure or ""),
            tracked_frames=tracked.count(True) if tracked else number_tracked,
            extra=item.extra | ({"stages_us": unknown_stages} if unknown_stages else {}),
            state=State.PENDING,
        )
    )


def frames_row(item: admission.Item, row: Run) -> RunFrames:
    """The frames of `row`, the run of `item`."""
    run = item.run
    assert run is not None  # an item without a run is rejected
    known = {name: each for name, each in (run.stages_us or {}).items() if name in STAGES}
    names, stages_us = packing.pack_stages(known)
    tracked = run.tracked if isinstance(run.tracked, list) else []
    series = packing.Series(packing.pack(run.frame_us), names, stages_us, packing.pack_tracked(tracked))
    return RunFrames(run=row, size=series.size, content=packing.compress(series))
