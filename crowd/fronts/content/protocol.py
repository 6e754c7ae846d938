"""The measuring protocol of a front: its members with types and ranges, and consistency checks.

Only this module lists the members: a new version of the protocol adds its members here.
"""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from typing import Annotated, Any

import msgspec

from crowd.fronts.front import ADAPTIVE, BEST, DEFAULT
from slam.protocol import FIRST_COUNTED_FRAME, VALID_BELOW, VERSION

MAX_RUNS = 50  # of a session
MAX_FRAMES = 10_000
AN_HOUR = 3600  # seconds

Frames = Annotated[int, msgspec.Meta(ge=1, le=MAX_FRAMES)]
FrameNumber = Annotated[int, msgspec.Meta(ge=0, le=MAX_FRAMES)]
Repeats = Annotated[int, msgspec.Meta(ge=1, le=MAX_RUNS)]
Metres = Annotated[float, msgspec.Meta(gt=0, le=10)]


class Protocol(msgspec.Struct, forbid_unknown_fields=True):
    """How clients measure. Times are seconds, `max_ate` metres, frames are counted from 0."""

    version: Annotated[int, msgspec.Meta(ge=VERSION, le=VERSION)]
    warmup_frames: FrameNumber
    frames: Frames
    first_counted_frame: FrameNumber
    order: Annotated[list[str], msgspec.Meta(min_length=2, max_length=MAX_RUNS)]
    repeats: Repeats
    rest_seconds: Annotated[float, msgspec.Meta(ge=0, le=AN_HOUR)]
    max_ate: Metres = VALID_BELOW


# What every session measures, forwards and back, so that a steady drift cancels in the pairs.
ORDERS = tuple([*names, *reversed(names)] for names in ((DEFAULT, BEST), (DEFAULT, BEST, ADAPTIVE)))
MEMBERS = tuple(field.name for field in msgspec.structs.fields(Protocol))


class JudgingMembers(msgspec.Struct):
    """The members that the server needs to judge runs."""

    version: Annotated[int, msgspec.Meta(ge=1)]
    frames: Frames
    first_counted_frame: FrameNumber
    order: list[str]
    repeats: Repeats
    max_ate: Metres = VALID_BELOW


def session_protocol(protocol: Mapping[str, Any], names: Collection[str]) -> dict[str, Any]:
    """`protocol` with the order for a front with the points `names`: `adaptive` is measured where it is one.

    An order that an administrator wrote stays.
    """
    if protocol.get("order") not in ORDERS:
        return dict(protocol)
    return {**protocol, "order": ORDERS[ADAPTIVE in names]}


def disagreements(protocol: Protocol, configurations: Collection[str]) -> Iterator[str]:
    """Inconsistencies of `protocol`, with itself or with the names of the front's `configurations`."""
    if protocol.first_counted_frame >= protocol.frames:
        yield f"first_counted_frame: {protocol.first_counted_frame} is not below frames ({protocol.frames})"
    counts = Counter(protocol.order)
    if unknown := [name for name in counts if name not in configurations]:
        yield (
            f"order: {unknown[0]!r:.80} is not a configuration of this front: choose from "
            f"{', '.join(configurations)}"
        )
    if DEFAULT not in counts:
        yield f"order: {DEFAULT} is missing: every speedup is measured against it"
    if len(counts) == 1:
        yield f"order: it only names {DEFAULT}: add a configuration to compare with it"
    if len(set(counts.values())) > 1:
        yield f"order: each configuration must appear equally often, not {dict(counts)}"
        return
    each = counts.most_common(1)[0][1]
    if protocol.repeats % each:
        yield f"repeats: order names each configuration {each} times: give {each} or a multiple of it"
    if (runs := protocol.repeats * len(counts)) > MAX_RUNS:
        yield f"repeats: {protocol.repeats} of {len(counts)} names are {runs} runs: give at most {MAX_RUNS}"


def judging_members(stored: Any) -> JudgingMembers | None:
    """The members of a `stored` protocol for judging runs; None if one is missing or wrong.

    A published front may be older than these checks, and cannot be changed.
    """
    try:
        protocol = msgspec.convert(stored, JudgingMembers)
    except msgspec.ValidationError:
        return None
    return protocol if protocol.first_counted_frame < protocol.frames else None


def max_ate(stored: Mapping[str, Any]) -> float:
    """The error (m) from which a run is invalid; the usual limit if `stored` has no valid one."""
    metres: float = _convert_or(stored.get("max_ate"), Metres, VALID_BELOW)
    return metres


def first_counted_frame(stored: Mapping[str, Any]) -> int:
    """The first frame that counts; the usual one if `stored` has no valid one."""
    frame: int = _convert_or(stored.get("first_counted_frame"), FrameNumber, FIRST_COUNTED_FRAME)
    return frame


def _convert_or(value: Any, kind: Any, otherwise: Any) -> Any:
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError:
        return otherwise
