"""The members that protocol 2 adds to sessions and runs. In protocol 1 they are unknown members.

A session has a fixed number of pairs. It reports the cost of an empty frame and the clock of the stage times.
A run reports its largest distance from the reference trajectory. This module does not use the database.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import msgspec

from crowd.results.intake.checks import MAX_FRAME_US, Protocol, Rejection
from crowd.results.intake.schema import Run
from slam.protocol import FIXED_PAIRS, NO_STAGES

EMPTY_FRAME_MISSING = Rejection(
    "empty_frame_missing",
    "empty_frame_us is missing: send what an empty frame costs on this backend, in microseconds",
    "empty_frame_us",
)
STAGE_CLOCK_MISSING = Rejection(
    "stage_clock_missing",
    "stage_clock is missing: say what took the times of the stages, device, wall or none",
    "stage_clock",
)
DEVIATION_MISSING = Rejection(
    "deviation_missing",
    "deviation is missing: send the largest distance of a position from the reference trajectory, in metres",
    "deviation",
)


class SessionMembers(msgspec.Struct):
    """The members of a session in addition to protocol 1."""

    empty_frame_us: Annotated[
        float,
        msgspec.Meta(
            ge=0,
            le=MAX_FRAME_US,
            description="protocol 2, required: microseconds that an empty frame costs on this backend",
        ),
    ]
    stage_clock: Annotated[
        Literal["device", "wall", "none"],
        msgspec.Meta(description="protocol 2, required: what took the times of the stages; none: no stages"),
    ]


class RunMembers(msgspec.Struct):
    """The members of a run in path of `trajectory_sha256`."""

    deviation: (
        Annotated[
            float,
            msgspec.Meta(
                ge=0,
                description="protocol 2, required where the status is ok: the largest distance (m) of a "
                "frame's position from the configuration's reference trajectory",
            ),
        ]
        | None
    ) = None


def check_session(unknown: Mapping[str, Any], earlier: str | None) -> Rejection | None:
    """Why a session is rejected, or None. UNKNOWN: its members beyond protocol 1.

    EARLIER: the clock of an earlier part of the session, None if this is the first part.
    """
    for missing in (EMPTY_FRAME_MISSING, STAGE_CLOCK_MISSING):
        if unknown.get(str(missing.field)) is None:
            return missing
    if earlier is not None and unknown["stage_clock"] != earlier:
        text = f"stage_clock: an earlier part of this session has {earlier!r}: use a new session id"
        return Rejection("session_taken", text, "stage_clock")
    return _type_error(unknown, SessionMembers)


def check_run(run: Run, unknown: Mapping[str, Any], protocol: Protocol, stage_clock: str) -> Rejection | None:
    """Why RUN is rejected, or None. STAGE_CLOCK is its session's; UNKNOWN: its members beyond protocol 1."""
    if run.repeat >= protocol.repeats:
        text = f"repeat {run.repeat}: this front has {protocol.repeats} of each configuration, from 0"
        return Rejection("too_many_repeats", text, "repeat")
    if run.stages_us and stage_clock == NO_STAGES:
        text = "stage_clock is none: leave stages_us out, or say what took these times"
        return Rejection("stages_without_clock", text, "stages_us")
    deviation = unknown.get("deviation")
    if deviation is None:
        return DEVIATION_MISSING if run.status == "ok" else None
    if isinstance(deviation, int | float) and deviation < 0:
        text = f"deviation is {deviation}: a distance in metres is 0 or more"
        return Rejection("negative_error", text, "deviation")
    return _type_error(unknown, RunMembers)


def split_members(
    version: int, unknown: Mapping[str, Any], members: type[msgspec.Struct]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Split the checked UNKNOWN into the MEMBERS of protocol 2 and the rest; in VERSION 1 all are rest."""
    if version != FIXED_PAIRS:
        return {}, dict(unknown)
    known = msgspec.structs.asdict(msgspec.convert(unknown, members))
    return known, {name: value for name, value in unknown.items() if name not in known}


def _type_error(unknown: Mapping[str, Any], members: type[msgspec.Struct]) -> Rejection | None:
    try:
        msgspec.convert(unknown, members)
    except msgspec.ValidationError as error:
        reason, _, path = str(error).partition(" - at `$.")
        code = "not_finite" if reason == "Number out of range" else "invalid_field"
        return Rejection(code, reason, path.rstrip("`"))
    return None
