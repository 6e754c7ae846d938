"""Checks of the values of a decoded submission. This module does not use the database."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from crowd.devices.naming.computing import WEBASSEMBLY
from crowd.devices.naming.raw_device import RAW_STRINGS
from crowd.http.problems import Problem
from crowd.results.intake.schema import Session
from wire.front import Errors, Protocol
from wire.protocol import BETWEEN_FRAMES_US, ERROR_ROUNDING, NO_STAGES, STAGE_TOLERANCE
from wire.session import MAX_FRAME_US, MAX_THREADS, Run, Sample

MAX_STAGES = 16
# Time of a session besides its frames: loading, warming up and rests, and time of each run. A client waits
# 180 s for a device that does not respond.
LOADING_SECONDS = 3_600
RUN_SECONDS = 240
DURATION_FACTOR = 10
MAX_DEVICE_DEPTH = 8
MAX_EXTRA_DEPTH = 8
CORES = re.compile(r"[1-9][0-9]{0,3}")
# Words in the name of a member that can identify or locate a person.
PERSONAL_WORDS = frozenset(
    {
        "account", "address", "adid", "advertising", "androidid", "bssid", "email", "fingerprint", "gaid",
        "gps", "host", "hostname", "iccid", "idfa", "imei", "imsi", "ip", "ipv4", "ipv6", "latitude",
        "location", "login", "longitude", "mac", "meid", "nickname", "owner", "phone", "serial", "ssaid",
        "ssid", "user", "username",
    }
)  # fmt: skip


@dataclass(frozen=True)
class Rejection:
    """Why a run is rejected: a stable code, what would be right, and the wrong member."""

    code: str
    detail: str
    field: str | None = None


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
THREADS_MISSING = Rejection(
    "threads_missing",
    f"threads is missing: say how many threads computed with WebAssembly, 1 to {MAX_THREADS}",
    "threads",
)
DEVIATION_MISSING = Rejection(
    "deviation_missing",
    "deviation is missing: send the largest distance of a position from the reference trajectory, in metres",
    "deviation",
)
ERRORS = ("ate_mean", "ate_rmse", "ate_max")  # of a run, the least first
# Members of a session that all its parts share: its runs are compared with each other.
SAME_IN_ALL_PARTS = ("stage_clock", "threads")


def check_device(raw: Mapping[str, Any]) -> None:
    """Raises Problem if the description `raw` of a device is nested too deeply, if a member that identifies
    the model is not text, or if the name of a member suggests personal data.
    """
    if _is_nested_deeper(raw, MAX_DEVICE_DEPTH):
        raise Problem(
            "device_too_deep", f"device is nested deeper than {MAX_DEVICE_DEPTH} levels", field="device"
        )
    for member in sorted(RAW_STRINGS & raw.keys()):
        if not isinstance(raw[member], str | None):
            raise Problem(
                "invalid_field",
                f"device.{member} is {raw[member]!r:.50}: send the device's own string, or null",
                field=f"device.{member}",
            )
    _refuse_personal(raw, "device.")


def check_extra(members: Mapping[str, Any], where: str) -> None:
    """Raises Problem 400 if unknown `members` are nested too deeply, or a name suggests personal data.

    `where` is their path with a final dot.
    """
    if _is_nested_deeper(members, MAX_EXTRA_DEPTH):
        text = f"unknown members are nested deeper than {MAX_EXTRA_DEPTH} levels"
        raise Problem("extra_too_deep", text, field=f"{where}{next(iter(members))}")
    _refuse_personal(members, where)


def check_extra_size(size: int, limit: int, field: str) -> None:
    """Raises Problem 400 if the `size` of unknown members, in bytes, is above `limit`."""
    if size > limit:
        raise Problem(
            "extra_too_large", f"unknown members take {size} bytes, at most {limit} are kept", field=field
        )


def _refuse_personal(members: Mapping[str, Any], where: str) -> None:
    name = _find_personal(members)
    if name is not None:
        raise Problem(
            "personal_data",
            f"{where}{name} could identify a person and is not accepted: leave it out",
            field=f"{where}{name}",
        )


def _is_nested_deeper(value: Any, levels: int) -> bool:
    """Whether `value` nests containers more than `levels` deep, without recursion."""
    nested = [value]
    for _ in range(levels + 1):
        containers = [one for one in nested if isinstance(one, dict | list)]
        nested = [inner for one in containers for inner in (one.values() if isinstance(one, dict) else one)]
        if not containers:
            return False
    return True


def _find_personal(value: Any) -> str | None:
    if isinstance(value, Mapping):
        for name, inner in value.items():
            words = set(re.split(r"[^a-z0-9]+", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()))
            if words & PERSONAL_WORDS or name.lower().replace("_", "") in PERSONAL_WORDS:
                return str(name)
            member = _find_personal(inner)
            if member is not None:
                return f"{name}.{member}"
    if isinstance(value, list):
        return next((member for inner in value if (member := _find_personal(inner)) is not None), None)
    return None


def check_conditions(session: Session, earlier: Mapping[str, Any] | None) -> Rejection | None:
    """Why `session` is rejected, from how it measured; None for a valid one.

    `earlier`: SAME_IN_ALL_PARTS of an earlier part of the session, None if this is the first part.
    """
    if session.empty_frame_us is None:
        return EMPTY_FRAME_MISSING
    if session.stage_clock is None:
        return STAGE_CLOCK_MISSING
    if session.backend == WEBASSEMBLY and session.threads is None:
        return THREADS_MISSING
    if session.backend != WEBASSEMBLY and session.threads is not None:
        text = (
            f"threads is {session.threads}, and the backend {session.backend}: only {WEBASSEMBLY} has threads"
        )
        return Rejection("threads_without_wasm", text, "threads")
    for member, before in (earlier or {}).items():
        if getattr(session, member) != before:
            text = f"{member}: an earlier part of this session has {before!r}: use a new session id"
            return Rejection("session_taken", text, member)
    return None


def claimed_cores(device: Mapping[str, Any]) -> int | None:
    """How many processors `device`, the description of one, says that it has; None if it does not say."""
    count = device.get("cpu_count")
    return int(count) if isinstance(count, str) and CORES.fullmatch(count) else None


def check_run(
    run: Run,
    configurations: Mapping[str, Errors | None],
    protocol: Protocol,
    stage_clock: str | None,
    cores: int | None = None,
) -> Rejection | None:
    """Why `run` is rejected, from its values; None for a valid run.

    `configurations`: by name, the errors of the reference trajectory, None where they are not known.
    `stage_clock` is its session's. `cores`: the processors that its device claims.
    """
    if run.configuration not in configurations:
        return Rejection(
            "unknown_configuration",
            f"{run.configuration!r} is not in this front: {', '.join(sorted(configurations))} are",
            "configuration",
        )
    frames = len(run.frame_us)
    if run.status == "ok" and frames != protocol.frames:
        return Rejection(
            "frame_count", f"frame_us has {frames} values, the protocol {protocol.frames}", "frame_us"
        )
    if run.status == "failed" and frames > protocol.frames:
        return Rejection(
            "frame_count", f"frame_us has {frames} values, at most {protocol.frames}", "frame_us"
        )
    if run.repeat >= protocol.repeats:
        text = f"repeat {run.repeat}: this front has {protocol.repeats} of each configuration, from 0"
        return Rejection("too_many_repeats", text, "repeat")
    if run.stages_us and stage_clock == NO_STAGES:
        text = "stage_clock is none: leave stages_us out, or say what took these times"
        return Rejection("stages_without_clock", text, "stages_us")
    if run.status == "ok" and run.deviation is None:
        return DEVIATION_MISSING
    return (
        _check_times(run, protocol)
        or _check_processor_time(run, protocol, cores)
        or _check_tracked(run)
        or _check_errors(run)
        or _check_reference(run, configurations[run.configuration])
    )


def check_samples(samples: Sequence[Sample], runs: Sequence[Run]) -> Rejection | None:
    """Why `samples` of a session with `runs` are rejected: more than one a second, or one after its end.

    The limits are generous, so that no honest client is refused: samples may be out of order or rounded. A
    session may take DURATION_FACTOR times as long as its frames, plus time for loading and for failed runs.
    """
    times = sorted(sample.t for sample in samples)
    early = next((number for number, t in enumerate(times) if t < number - 1), None)
    if early is not None:
        text = f"{early + 1} samples in the first {times[early]:.3f} s: send at most one a second"
        return Rejection("too_many_samples", text, "samples")
    measured = sum(sum(run.frame_us) for run in runs) * 1e-6
    longest = LOADING_SECONDS + RUN_SECONDS * len(runs) + DURATION_FACTOR * measured
    if times and times[-1] > longest:
        text = f"a sample at {times[-1]:.0f} s, but the session's {len(runs)} runs took {measured:.0f} s"
        return Rejection("too_many_samples", text, "samples")
    return None


def _check_times(run: Run, protocol: Protocol) -> Rejection | None:
    stages = run.stages_us or {}
    if len(stages) > MAX_STAGES:
        return Rejection("too_many_stages", f"{len(stages)} stages, at most {MAX_STAGES}", "stages_us")
    for field, series in (
        ("frame_us", run.frame_us),
        *((f"stages_us.{name}", s) for name, s in stages.items()),
    ):
        if len(series) != len(run.frame_us):
            return Rejection(
                "frame_count", f"{field} has {len(series)} values, frame_us {len(run.frame_us)}", field
            )
        if series and min(series) < 0:
            return Rejection("negative_time", f"{field} holds {min(series)}: times are 0 or more", field)
        if series and max(series) > MAX_FRAME_US:
            return Rejection(
                "time_too_large", f"{field} holds {max(series)}: at most {MAX_FRAME_US} microseconds", field
            )
    if run.status == "ok" and not any(run.frame_us[protocol.first_counted_frame :]):
        return Rejection(
            "zero_time", "every counted frame took 0 microseconds: the clock did not run", "frame_us"
        )
    return None


def _check_processor_time(run: Run, protocol: Protocol, cores: int | None) -> Rejection | None:
    """The threads of a run cannot compute for longer than all `cores` did."""
    if run.cpu_us is None or cores is None:
        return None
    counted = run.frame_us[protocol.first_counted_frame :]
    most = cores * (STAGE_TOLERANCE * sum(counted) + BETWEEN_FRAMES_US * len(counted))
    if run.cpu_us <= most:
        return None
    text = (
        f"cpu_us is {run.cpu_us}, but cpu_count is {cores} and the counted frames took {sum(counted)} "
        "microseconds: send the processor time of these frames alone, in microseconds"
    )
    return Rejection("processor_time_too_large", text, "cpu_us")


def _check_tracked(run: Run) -> Rejection | None:
    frames = len(run.frame_us)
    reported = len(run.tracked) if isinstance(run.tracked, list) else run.tracked
    if isinstance(run.tracked, list):
        wrong = reported not in (0, frames)
    else:
        wrong = reported is not None and reported > frames
    if wrong:
        return Rejection("frame_count", f"tracked has {reported} frames, frame_us has {frames}", "tracked")
    return None


def _check_errors(run: Run) -> Rejection | None:
    for field in (*ERRORS, "deviation"):
        value = getattr(run, field)
        if value is not None and (value < 0 or not math.isfinite(value)):
            return Rejection(
                "negative_error", f"{field} is {value}: a distance in metres is 0 or more", field
            )
    known = [(field, value) for field in ERRORS if (value := getattr(run, field)) is not None]
    for (field, value), (larger, most) in pairwise(known):
        if value > most + ERROR_ROUNDING:
            text = (
                f"{field} is {value} and {larger} {most}: the mean is at most the rmse, the rmse the largest"
            )
            return Rejection("errors_out_of_order", text, field)
    return None


def _check_reference(run: Run, reference: Errors | None) -> Rejection | None:
    """The errors of a run differ from those of the `reference` trajectory by twice its deviation at most.

    Let r and q be the positions of the run and of the reference. Both cameras start without rotation, so the
    same rotation R lays each first pose on the true one, at t: R (r - r0) + t and R (q - q0) + t. In each
    frame these differ by |(r - q) - (r0 - q0)|, which is at most twice the deviation. So do their distances
    from the truth, and by the triangle inequality the largest of these, their mean and their root mean
    square. ERROR_ROUNDING is for what clients round.
    """
    if reference is None or run.deviation is None:
        return None
    most = 2 * run.deviation + ERROR_ROUNDING
    for field in reversed(ERRORS):
        value, right = getattr(run, field), getattr(reference, field)
        if value is not None and abs(value - right) > most:
            text = (
                f"{field} is {value:.3g} m, that of the reference trajectory {right:.3g} m: with a deviation "
                f"of {run.deviation:.3g} m they differ by {most:.3g} m at most. Rotate the positions into "
                "the frame of the first true pose before you compare them with the truth"
            )
            return Rejection("error_contradicts_deviation", text, field)
    return None
