"""Members of a submission that this version does not know: a newer client's are kept as they came.

They are stored beside what is known, are returned with a participant's own data, and do not count anywhere.
"""

from dataclasses import dataclass
from typing import Any

import msgspec

from crowd.http.decoding import decoded_part, size_of
from crowd.results.intake import checks
from crowd.results.intake.schema import Run, Sample, Session, Submission

MAX_BYTES = 4 << 10  # of one run, or of the submission itself
MAX_SESSION_BYTES = 16 << 10  # with its samples

Members = dict[str, msgspec.Raw]

_MEMBERS = msgspec.json.Decoder(Members)
_SEVERAL = msgspec.json.Decoder(list[Members])
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

    Raises Problem 400 for what is nested too deeply, too large, an infinite number, or named after a person.
    """
    members = _MEMBERS.decode(body)
    sessions = _SEVERAL.decode(members["sessions"])
    return Extras(
        _decoded(_unknown(members, Submission), "", MAX_BYTES),
        [_of_session(session, f"sessions[{place}].") for place, session in enumerate(sessions)],
    )


def of_run(raw: msgspec.Raw) -> dict[str, Any]:
    """What RAW, a run that fits the schema, has beyond it. Raises Problem as `of_submission` does."""
    return _decoded(_unknown(_MEMBERS.decode(raw), Run), "", MAX_BYTES)


def _of_session(members: Members, where: str) -> SessionExtras:
    own = _decoded(_unknown(members, Session), where, MAX_SESSION_BYTES)
    samples = _SEVERAL.decode(members["samples"]) if "samples" in members else []
    unknown = [_unknown(sample, Sample) for sample in samples]
    checks.check_extra_size(sum(map(_size, unknown)), MAX_SESSION_BYTES, f"{where}samples")
    return SessionExtras(
        own, [_decoded(sample, f"{where}samples[].", MAX_SESSION_BYTES) for sample in unknown]
    )


def _unknown(members: Members, known: type[msgspec.Struct]) -> Members:
    """Those of MEMBERS that KNOWN does not have, in the order in which they came."""
    if members.keys() <= set(known.__struct_fields__):
        return {}
    return {name: raw for name, raw in members.items() if name not in known.__struct_fields__}


def _size(members: Members) -> int:
    return sum(len(name.encode()) + size_of(raw) for name, raw in members.items())


def _decoded(members: Members, where: str, most: int) -> dict[str, Any]:
    """MEMBERS, found at WHERE (a path up to its dot). Nothing larger than MOST bytes is decoded."""
    if not members:
        return {}
    checks.check_extra_size(_size(members), most, f"{where}{next(iter(members))}")
    found = {name: decoded_part(_ANYTHING, raw, f"{where}{name}") for name, raw in members.items()}
    checks.check_extra(found, where)
    return found
