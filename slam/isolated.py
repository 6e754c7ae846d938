"""One measurement in its own process: `python -m slam run` for callers that must survive its crash.

OpenCL hangs in a forked child, a driver may abort its process, and a large volume may exhaust the memory.
Each such end raises a MeasurementError with its reason, or a CannotMeasureHereError where this machine can
measure no configuration at all. On Linux the process ends with the one that started it, even when that is
killed.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO

from slam.child_process import ROOT, dies_with_parent, ending, last_line
from slam.public_text import one_line
from slam.stopping import Condition
from slam.validity import tracking_failure
from wire.protocol import FIRST_COUNTED_FRAME, RUNTIMES, VALID_BELOW

PROGRAM = (sys.executable, "-m", "slam")
TIMEOUT_SECONDS = 900.0
HEARTBEAT_SECONDS = 15.0
STAGES = ("preprocessing", "tracking", "integration", "raycasting", "computation")
NO_OBJECTIVES = ("sequence", "lost", "stopped_at")  # members of a part
LARGEST_SO_FAR = ("runtime_max", "peak_memory_bytes")  # a part of a run has a bound of the whole's
LARGEST_COUNTS = ("runtime_p95", "runtime_max", "peak_memory_bytes")  # of several sequences
# The exit code of `python -m slam` without a suitable device.
NO_DEVICE = 3


class MeasurementError(RuntimeError):
    """A configuration that could not be measured; the message is stored as the reason."""


class CannotMeasureHereError(RuntimeError):
    """This machine cannot measure any configuration, another one may; the message says why."""


class LeaseLostError(RuntimeError):
    """The lease of this measurement is gone: its result is not needed."""


@dataclass(frozen=True)
class Measurement:
    """`objectives`: runtime in seconds a frame, ate_* in metres. `stages`: mean seconds a frame, of those
    known. Both are over the sequences learned on. `parts`: the objectives of each sequence that was run, with
    its name as `sequence`, how many frames were `lost`, and after how many it was `stopped_at`, None where it
    ran to its end. Errors, `runtime_max` and memory of a stopped one are bounds: those of the whole run are
    that or more. `reference`: what `measure_reference` adds.
    """

    objectives: dict[str, float]
    stages: dict[str, float] = field(default_factory=dict)
    device: dict[str, Any] = field(default_factory=dict)
    parts: tuple[dict[str, Any], ...] = ()
    reference: dict[str, Any] | None = None


def measure(
    system: str,
    configuration: Mapping[str, Any],
    sequences: Sequence[Path],
    *,
    device: str = "",
    backend: str = "opencl",
    frames: int | None = None,
    perturbation: int | None = None,
    stop_above: Sequence[Condition] = (),
    stop_after: int = 1,
    learned_on: int | None = None,
    decoded: Path | None = None,
    heartbeat: Callable[[], bool] | None = None,
    heartbeat_seconds: float = HEARTBEAT_SECONDS,
    timeout: float = TIMEOUT_SECONDS,
) -> Measurement:
    """Run `configuration` over the first `frames` (all where None) of each of `sequences`; what was measured.

    The objectives are those of `combine` over the first `learned_on` sequences (all where None). The others
    are held out: if the camera is lost there, that is a result. `perturbation` is the seed by which depth is
    changed by a unit. A sequence ends once one of `stop_above` is certainly broken (see `slam.stopping`), and
    after `stop_after` sequences that broke one, no other is run. Decoded depth is kept in the folder
    `decoded`, if one is given, for later measurements.
    `heartbeat` is called every `heartbeat_seconds` while it runs; LeaseLostError is raised as soon as it
    answers False. Raises MeasurementError where the program fails, is killed, takes longer than `timeout`
    seconds for each sequence or reports no finite values, CannotMeasureHereError where `device` is not here
    or no process can be started.
    """
    command = ["run", *_configured(system, configuration, sequences, frames), "--backend", backend]
    if device:
        command += ["--device", device]
    if perturbation is not None:
        command += ["--perturb", str(perturbation)]
    for condition in stop_above:
        command += ["--stop-above", ",".join(f"{name}={value!r}" for name, value in condition.items())]
    if stop_above:
        command += ["--stop-after", str(stop_after)]
    if decoded is not None:
        command += ["--decoded", str(decoded.absolute())]
    report = _run(command, heartbeat, heartbeat_seconds, timeout * len(sequences))
    with _readable():
        return read_report(report, learned_on)


def measure_reference(
    system: str,
    configuration: Mapping[str, Any],
    sequence: Path,
    *,
    frames: int | None = None,
    heartbeat: Callable[[], bool] | None = None,
    heartbeat_seconds: float = HEARTBEAT_SECONDS,
    timeout: float = TIMEOUT_SECONDS,
) -> Measurement:
    """Run `configuration` over the first `frames` of `sequence` on every device here, in every layout.

    The measurement is that of the first; its `reference` has `trajectory` (m, a position a frame), `band`
    (m), `largest_deviation` (m) between any two, the names of the `variants` that ran, and the share of the
    counted frames that the first `skipped`, None if all are computed. Arguments and errors are those of
    `measure`, but `timeout` is for all devices together.
    """
    command = ["reference", *_configured(system, configuration, [sequence], frames)]
    answer = _run(command, heartbeat, heartbeat_seconds, timeout)
    with _readable():
        return replace(read_report(answer["report"]), reference=dict(answer["reference"]))


def _configured(
    system: str, configuration: Mapping[str, Any], sequences: Sequence[Path], frames: int | None
) -> list[str]:
    """The options of a command that runs `configuration`."""
    options = ["--system", system]
    for sequence in sequences:
        options += ["--sequence", str(sequence.absolute())]
    for name, value in configuration.items():
        options += ["--set", f"{name}={int(value) if isinstance(value, bool) else value!r}"]
    return options if frames is None else [*options, "--frames", str(frames)]


def _run(
    command: Sequence[str],
    heartbeat: Callable[[], bool] | None,
    heartbeat_seconds: float,
    timeout: float,
) -> Any:
    """What `command` of `python -m slam` writes as JSON. Raises as `measure`."""
    with tempfile.TemporaryDirectory(prefix="frontrunner-", ignore_cleanup_errors=True) as folder:
        report, errors = Path(folder) / "report.json", Path(folder) / "errors.txt"
        with errors.open("wb") as stream:
            process = _start([*PROGRAM, *command, "--json", str(report)], stream)
        try:
            code = _wait(process, heartbeat, heartbeat_seconds, timeout)
        finally:
            _end(process)
        if code != 0:
            raise _failure(code, errors.read_text(errors="replace"))
        with _readable():
            return json.loads(report.read_text())


@contextlib.contextmanager
def _readable() -> Iterator[None]:
    """Raise MeasurementError where the block cannot read a report."""
    try:
        yield
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        what = f"the report cannot be read: {type(error).__name__}: {error}"
        raise MeasurementError(one_line(what)) from error


def read_report(report: Mapping[str, Any], learned_on: int | None = None) -> Measurement:
    """The measurement in a report of `python -m slam run --json`, of one sequence or of several.

    Objectives and stages are those of the first `learned_on` sequences, of all if it is None. Raises
    MeasurementError where the trajectory error is unknown or of too few frames, no frame was run, a value is
    not finite, or the camera was lost on a sequence learned on: it has no usable result.
    """
    reports = report.get("runs", [report])
    count = len(reports) if learned_on is None else learned_on
    read = [_read_one(one, held_out=number >= count) for number, one in enumerate(reports)]
    parts = [part for part, _ in read]
    stage_times = [each for _, each in read[:count]]
    stages = {
        stage: sum(each[stage] for each in stage_times) / len(stage_times)
        for stage in STAGES
        if all(stage in each for each in stage_times)
    }
    return Measurement(combine(parts[:count]), stages, dict(reports[0]["device"]), tuple(parts))


def combine(parts: Sequence[Mapping[str, Any]], ignored: int = 0) -> dict[str, float]:
    """The objectives of a measurement from those of its sequences, `parts` as in `Measurement`.

    Errors are the worst of all sequences without the `ignored` largest ones. Memory, `runtime_p95` and
    `runtime_max` are the largest, everything else is the mean.
    """
    names = [name for name in parts[0] if name not in NO_OBJECTIVES and all(name in part for part in parts)]
    return {name: _combined(name, [float(part[name]) for part in parts], ignored) for name in names}


def bounds(parts: Sequence[Mapping[str, Any]], wanted: int, ignored: int = 0) -> list[str]:
    """The names of the objectives `combine` gives of which only a bound is known.

    `parts` are those of the first of `wanted` sequences; some of them may have stopped early. Values that are
    not known may be anything above: those that would change the result are bounds.
    """
    whole = combine(parts, ignored)
    names = [name for name in whole if name.startswith("ate_") or name in LARGEST_SO_FAR]
    unknown = dict.fromkeys(names, math.inf)
    most = [part if part.get("stopped_at") is None else {**part, **unknown} for part in parts]
    most += [{**parts[0], **unknown}] * (wanted - len(parts))
    worst_case = combine(most, ignored)
    return [name for name in names if worst_case[name] != whole[name]]


def worst(values: Iterable[float], ignored: int = 0) -> float:
    """The largest of `values` without the `ignored` largest; the least where there are only `ignored`."""
    ordered = sorted(values, reverse=True)
    return ordered[min(ignored, len(ordered) - 1)]


def _combined(name: str, values: Sequence[float], ignored: int) -> float:
    if name.startswith("ate_"):
        return worst(values, ignored)
    return max(values) if name in LARGEST_COUNTS else sum(values) / len(values)


def _read_one(report: Mapping[str, Any], held_out: bool) -> tuple[dict[str, Any], dict[str, float]]:
    """The part and the stages of one sequence.

    On one `held_out` a lost camera is a result: `lost` frames, all of them where none was tracked.
    """
    if report["ate"] is None:
        raise MeasurementError("the sequence has no true trajectory, so the error is unknown")
    if not report["frames"]:
        raise MeasurementError("the report holds no frame: nothing was measured")
    stop = report.get("stopped")
    if stop and "ate_online" in report:  # earlier poses may still be corrected
        raise MeasurementError(f"stopped after {stop['frames']} of {stop['wanted']} frames: {stop['reason']}")
    if report["not_valid_because"] and report["valid"] is None and not stop:
        raise MeasurementError(f"the trajectory was not compared: {report['not_valid_because']}")
    counted = report["frames"][FIRST_COUNTED_FRAME:] or report["frames"]
    frames = len(report["frames"])
    tracked = [frame["tracked"] for frame in report["frames"]]
    failure = tracking_failure(tracked)
    if failure and report["ate"]["max"] < VALID_BELOW and not held_out and not stop:
        raise MeasurementError(f"{report['sequence']['name']}: {failure}")
    objectives = {
        **{name: report[name] for name in RUNTIMES},
        **{f"ate_{name}": value for name, value in _least_errors(report).items()},
    }
    objectives["cpu_seconds"] = report["cpu_seconds"] / frames
    if report["waited_us"] is not None:
        objectives["waited_seconds"] = report["waited_us"] * 1e-6 / len(counted)
    if report["peak_memory_bytes"] is not None:
        objectives["peak_memory_bytes"] = report["peak_memory_bytes"]
    if report["energy_joules"] is not None:
        objectives["energy_joules"] = report["energy_joules"] / frames
    measured = [stage for stage in STAGES if counted[0][stage] is not None]
    stages = {stage: sum(frame[stage] for frame in counted) / len(counted) for stage in measured}
    for name, value in (objectives | stages).items():
        if not math.isfinite(value):
            raise MeasurementError(f"{name} is {value}: the program measured nothing finite")
    lost = tracked.count(False) or (frames if failure else 0)
    stopped_at = stop["frames"] if stop else None
    part = {"sequence": report["sequence"]["name"], "lost": lost, "stopped_at": stopped_at, **objectives}
    return part, stages


def _least_errors(report: Mapping[str, Any]) -> dict[str, float]:
    """The errors of a run; of one that stopped, the least that those of the whole run can be.

    The frames that were left out may all be without an error, which lowers the mean, and so may the alignment
    of the whole run.
    """
    errors, stop = dict(report["ate"]), report.get("stopped")
    if stop:
        share = report["matched_poses"] / (report["matched_poses"] + stop["wanted"] - stop["frames"])
        errors |= {name: value * share**0.5 for name, value in errors.items() if name.startswith("rmse")}
        errors["mean"] *= share
    return errors


def _start(command: Sequence[str], errors: BinaryIO) -> subprocess.Popen[bytes]:
    try:
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=errors,
            cwd=ROOT,
            start_new_session=True,
            preexec_fn=dies_with_parent(signal.SIGKILL, first_to_go=True),
        )
    except OSError as error:
        raise CannotMeasureHereError(one_line(f"no process can be started: {error}")) from error


def _wait(
    process: subprocess.Popen[bytes],
    heartbeat: Callable[[], bool] | None,
    heartbeat_seconds: float,
    timeout: float,
) -> int:
    limit = time.monotonic() + timeout
    while True:
        left = limit - time.monotonic()
        if left <= 0:
            raise MeasurementError(f"no result after {timeout:g} s")
        try:
            return process.wait(min(heartbeat_seconds, left))
        except subprocess.TimeoutExpired:
            if heartbeat is not None and not heartbeat():
                raise LeaseLostError from None


def _end(process: subprocess.Popen[bytes]) -> None:
    if hasattr(os, "killpg"):
        # The group, so that nothing the program started is left behind.
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
    process.wait()


def _failure(code: int, errors: str) -> MeasurementError | CannotMeasureHereError:
    if code == NO_DEVICE:
        return CannotMeasureHereError(one_line(last_line(errors)))
    return MeasurementError(ending(code, errors))
