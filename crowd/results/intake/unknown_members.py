"""Members of a submission that this version does not know: a newer client's are kept as they came.

They are stored beside what is known, come back with a participant's own data, and count nowhere.
"""

from dataclasses import dataclass
from typing import Any

import msgspec

from crowd.decoding import decoded
from crowd.results.intake import checks
from crowd.results.intake.schema import Run, Sample, Session, Submission

MAX_BYTES = 4 << 10  # of one run, or of the submission itself
MAX_SESSION_BYTES = 16 << 10  # with its samples

_MEMBERS = msgspec.json.Decoder(dict[str, msgspec.Raw])
_OBJECTS = msgspec.json.Decoder(list[dict[str, msgspec.Raw]])
_ANYTHING = msgspec.json.Decoder()


@dataclass(frozen=True)
class SessionExtras:
    """What one session has beyond the schema: members of its own, and one dict a sample (mostly empty)."""

    members: dict[str, Any]
    samples: list[dict[str, Any]]


@dataclass(frozen=True)
class Extras:
    """What a submission has beyond the schema, its runs aside."""

    members: dict[str, Any]
    sessions: list[SessionExtras]


def of_submission(body: bytes) -> Extras:
    """What BODY, a submission that fits the schema, has beyond it.

    Raises Problem 400 for what is nested too deeply, too large, no JSON number, or named after a person.
    """
    members = decoded(_MEMBERS, body)
    sessions = decoded(_OBJECTS, bytes(members["sessions"]))
    return Extras(
        _unknown(members, Submission, "", MAX_BYTES),
        [_of_session(session, f"sessions[{place}].") for place, session in enumerate(sessions)],
    )


def of_run(raw: msgspec.Raw) -> dict[str, Any]:
    """What RAW, a run that fits the schema, has beyond it. Raises Problem as `of_submission` does."""
    return _unknown(decoded(_MEMBERS, bytes(raw)), Run, "", MAX_BYTES)


def _of_session(members: dict[str, msgspec.Raw], where: str) -> SessionExtras:
    own = _unknown(members, Session, where, MAX_SESSION_BYTES)
    samples = decoded(_OBJECTS, bytes(members.get("samples", b"[]")))
    of_samples = [_unknown(sample, Sample, f"{where}samples[].", MAX_SESSION_BYTES) for sample in samples]
    checks.check_size([sample for sample in of_samples if sample], MAX_SESSION_BYTES, f"{where}samples")
    return SessionExtras(own, of_samples)


def _unknown(
    members: dict[str, msgspec.Raw], known: type[msgspec.Struct], where: str, most: int
) -> dict[str, Any]:
    names = members.keys() - set(known.__struct_fields__)
    if not names:
        return {}
    # In the order they came, whatever the set's.
    found = {name: decoded(_ANYTHING, bytes(members[name])) for name in members if name in names}
    checks.check_extra(found, most, where)
    return found
