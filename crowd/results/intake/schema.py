"""Decodes submissions, as `wire/session.py` declares them. Types are checked strictly, values run by run.

Runs are decoded one by one: a wrong type rejects only its own run. Too many sessions are refused before they
are decoded. Unknown members are not an error, since a newer client may send more:
`crowd.results.intake.unknown_members` keeps them.
"""

from typing import Any

import msgspec

from crowd.http.decoding import decode_body, decode_part, raw_size
from crowd.http.problems import Problem
from wire import session as declared
from wire.session import MAX_SESSIONS, SCHEMA_VERSION, Enrolment, Run

MAX_DEVICE_BYTES = 16 << 10
MAX_ID_BYTES = 64


class Session(declared.Session, frozen=True):
    """A session whose runs are not decoded yet."""

    runs: list[msgspec.Raw]  # type: ignore[assignment]


class Submission(declared.Submission, frozen=True):
    """A submission whose runs are not decoded yet."""

    sessions: list[Session]  # type: ignore[assignment]


class _Envelope(declared.Submission, frozen=True):
    """A submission whose device and sessions are not decoded yet."""

    device: msgspec.Raw  # type: ignore[assignment]
    sessions: list[msgspec.Raw]  # type: ignore[assignment]


class _Identified(msgspec.Struct):
    id: msgspec.Raw = msgspec.Raw(b"null")


_ENVELOPE = msgspec.json.Decoder(_Envelope)
_DEVICE = msgspec.json.Decoder(dict[str, Any])
_SESSION = msgspec.json.Decoder(Session)
_ENROLMENT = msgspec.json.Decoder(Enrolment)
_RUN = msgspec.json.Decoder(Run)
_IDENTIFIED = msgspec.json.Decoder(_Identified)
_ANYTHING = msgspec.json.Decoder()


def decode_submission(body: bytes) -> Submission:
    """Decode `body`, a submission, but not its runs.

    Raises Problem 400: malformed_json, too_many_values, text_too_long, not_finite, null_character,
    unknown_schema_version, device_too_large or invalid_field.
    """
    envelope = _envelope(body)
    if (size := raw_size(envelope.device)) > MAX_DEVICE_BYTES:
        text = f"device takes {size} bytes, at most {MAX_DEVICE_BYTES}"
        raise Problem("device_too_large", text, field="device")
    if (count := len(envelope.sessions)) > MAX_SESSIONS:
        text = f"{count} sessions: send at most {MAX_SESSIONS}"
        raise Problem("invalid_field", text, field="sessions")
    decoded = {
        "device": decode_part(_DEVICE, envelope.device, "device"),
        "sessions": [
            decode_part(_SESSION, raw, f"sessions[{index}]") for index, raw in enumerate(envelope.sessions)
        ],
    }
    return Submission(**msgspec.structs.asdict(envelope) | decoded)


def _envelope(body: bytes) -> _Envelope:
    try:
        return decode_body(_ENVELOPE, body)
    except Problem as problem:
        if problem.field != "schema_version":
            raise
        text = f"this server reads schema_version {SCHEMA_VERSION}"
        raise Problem("unknown_schema_version", text, field=problem.field) from problem


def decode_enrolment(body: bytes) -> Enrolment:
    """Decode `body`, an enrolment. Raises Problem as `decode_submission` does."""
    return decode_body(_ENROLMENT, body)


def decode_run(raw: msgspec.Raw) -> Run:
    """Decode `raw`, a run. Raises Problem with the member in `field`, relative to the run: `frame_us[3]`."""
    return decode_part(_RUN, raw)


def decode_id(raw: msgspec.Raw) -> str | None:
    """The id of `raw`, a run, even if the rest is invalid; None without a valid id."""
    try:
        name = _IDENTIFIED.decode(raw).id
        if raw_size(name) > MAX_ID_BYTES + len('""'):
            return None
        text = _ANYTHING.decode(name)
    except (msgspec.DecodeError, RecursionError):
        return None
    return text if isinstance(text, str) else None
