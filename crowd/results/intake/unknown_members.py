"""Members of a submission that this version does not know, such as those of a newer client.

WITHOUT_COLUMN are kept with them. They are stored as sent and returned with a participant's own data. Nothing
else uses them.
"""

from dataclasses import dataclass
from typing import Any

import msgspec

from crowd.http.decoding import decode_part, raw_size
from crowd.results.intake import checks
from wire.session import Run, Sample, Session, Submission

MAX_BYTES = 4 << 10  # of one run, or of the submission itself
MAX_SESSION_BYTES = 16 << 10  # with its samples
WITHOUT_COLUMN = frozenset({"threads_claimed"})

Members = dict[str, msgspec.Raw]

_MEMBERS = msgspec.json.Decoder(Members)
_MEMBER_LISTS = msgspec.json.Decoder(list[Members])
_ANYTHING = msgspec.json.Decoder()


@dataclass(frozen=True)
class SessionExtras:
    """The unknown members of a session, and of each of its samples (mostly empty)."""

    members: dict[str, Any]
    samples: list[dict[str, Any]]


@dataclass(frozen=True)
class Extras:
    """The unknown members of a submission, without those of its runs."""

    members: dict[str, Any]
    sessions: list[SessionExtras]


def extras_of_submission(body: bytes) -> Extras:
    """The unknown members of `body`, a submission that fits the schema.

    Raises Problem 400 for members that are nested too deeply, too large, not finite, or named after personal
    data.
    """
    members = _MEMBERS.decode(body)
    sessions = _MEMBER_LISTS.decode(members["sessions"])
    return Extras(
        _decode(_unknown_members(members, Submission), "", MAX_BYTES),
        [_extras_of_session(session, f"sessions[{index}].") for index, session in enumerate(sessions)],
    )


def extras_of_run(raw: msgspec.Raw) -> dict[str, Any]:
    """The unknown members of `raw`, a run that fits the schema. Raises Problem as `extras_of_submission`."""
    return _decode(_unknown_members(_MEMBERS.decode(raw), Run), "", MAX_BYTES)


def _extras_of_session(members: Members, where: str) -> SessionExtras:
    extra = _decode(_unknown_members(members, Session), where, MAX_SESSION_BYTES)
    samples = _MEMBER_LISTS.decode(members["samples"]) if "samples" in members else []
    unknown = [_unknown_members(sample, Sample) for sample in samples]
    checks.check_extra_size(sum(map(_size, unknown)), MAX_SESSION_BYTES, f"{where}samples")
    return SessionExtras(
        extra, [_decode(sample, f"{where}samples[].", MAX_SESSION_BYTES) for sample in unknown]
    )


def _unknown_members(members: Members, struct: type[msgspec.Struct]) -> Members:
    """The `members` that `struct` does not have or nothing stores, in the order sent."""
    stored = set(struct.__struct_fields__) - WITHOUT_COLUMN
    if members.keys() <= stored:
        return {}
    return {name: raw for name, raw in members.items() if name not in stored}


def _size(members: Members) -> int:
    return sum(len(name.encode()) + raw_size(raw) for name, raw in members.items())


def _decode(members: Members, where: str, limit: int) -> dict[str, Any]:
    """Decode `members`.

    `where` is their path with a final dot. More than `limit` bytes are refused undecoded.
    """
    if not members:
        return {}
    checks.check_extra_size(_size(members), limit, f"{where}{next(iter(members))}")
    decoded = {name: decode_part(_ANYTHING, raw, f"{where}{name}") for name, raw in members.items()}
    checks.check_extra(decoded, where)
    return decoded
