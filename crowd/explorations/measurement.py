"""Measuring one configuration in a fresh process.

OpenCL hangs in a forked child and may abort its process; a worker that only waits for another program
survives both, and each such end is a failed measurement with its reason.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from django.conf import settings

from crowd.explorations.models import Evaluation, Exploration
from crowd.fronts import sequences

TIMEOUT_SECONDS = 900.0
HEARTBEAT_SECONDS = 15.0
FIRST_COUNTED_FRAME = 10
STAGES = ("preprocessing", "tracking", "integration", "raycasting", "computation")
REASON_LENGTH = 500


class MeasurementError(RuntimeError):
    """A configuration that could not be measured; the message is the reason that is kept."""


class LeaseLostError(RuntimeError):
    """Someone else measures this configuration by now."""


@dataclass(frozen=True)
class Measurement:
    """`objectives`: runtime in seconds a frame, ate_* in metres; `stages`: mean seconds a frame."""

    objectives: dict[str, float]
    stages: dict[str, float]
    device: dict[str, Any]


def measure(evaluation: Evaluation, heartbeat: Callable[[], bool] | None = None) -> Measurement:
    """Measure EVALUATION's configuration on this machine; HEARTBEAT and errors as in `run`."""
    exploration = evaluation.exploration
    return run(
        exploration.application,
        evaluation.configuration,
        pack_of(exploration),
        exploration.reference_device.opencl_device,
        heartbeat,
    )


def pack_of(exploration: Exploration) -> Path:
    """The folder of the exploration's sequence.

    Raises MeasurementError where this machine has no such pack: another name, or other content.
    """
    for pack in sequences.packs():
        description = json.loads((pack / "pack.json").read_text())
        if (description["name"], description["sha256"]) == (
            exploration.sequence,
            exploration.sequence_sha256,
        ):
            return pack
    raise MeasurementError(
        f"no pack {exploration.sequence} with digest {exploration.sequence_sha256[:12]}... on this machine: "
        "put it into one of the sequence folders"
    )


def run(
    system: str,
    configuration: Mapping[str, Any],
    sequence: Path,
    device: str = "",
    heartbeat: Callable[[], bool] | None = None,
    timeout: float = TIMEOUT_SECONDS,
) -> Measurement:
    """Run CONFIGURATION over SEQUENCE in a new process and return what it reports.

    HEARTBEAT is called every HEARTBEAT_SECONDS while it runs; LeaseLostError is raised as soon as it answers
    False. Raises MeasurementError where the program fails, is killed, takes longer than TIMEOUT or reports
    no finite values.
    """
    command = [sys.executable, "-m", "slam", "run", "--system", system, "--sequence", str(sequence)]
    for name, value in configuration.items():
        command += ["--set", f"{name}={int(value) if isinstance(value, bool) else value!r}"]
    if device:
        command += ["--device", device]
    with tempfile.TemporaryDirectory(prefix="frontrunner-") as folder:
        report, errors = Path(folder) / "report.json", Path(folder) / "errors.txt"
        with errors.open("wb") as stream:
            process = subprocess.Popen(
                [*command, "--json", str(report)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=stream,
                cwd=settings.BASE_DIR,
                start_new_session=True,
            )
            try:
                code = _wait(process, heartbeat, timeout)
            finally:
                _end(process)
        if code != 0:
            raise MeasurementError(_reason(code, errors.read_text(errors="replace")))
        try:
            return read_report(json.loads(report.read_text()))
        except (OSError, ValueError) as error:
            raise MeasurementError(f"the report cannot be read: {error}"[:REASON_LENGTH]) from error


def read_report(report: Mapping[str, Any]) -> Measurement:
    """The measurement in a report of `python -m slam run --json`.

    Raises MeasurementError where the trajectory error is unknown: nothing can be learnt from it.
    """
    if report["ate"] is None:
        raise MeasurementError("the sequence has no true trajectory, so the error is unknown")
    counted = report["frames"][FIRST_COUNTED_FRAME:] or report["frames"]
    frames = len(report["frames"])
    objectives = {
        "runtime": report["runtime"],
        **{f"ate_{name}": value for name, value in report["ate"].items()},
    }
    objectives["cpu_seconds"] = report["cpu_seconds"] / frames
    if report["peak_memory_bytes"] is not None:
        objectives["peak_memory_bytes"] = report["peak_memory_bytes"]
    if report.get("energy_joules") is not None:
        objectives["energy_joules"] = report["energy_joules"] / frames
    stages = {stage: sum(frame[stage] for frame in counted) / len(counted) for stage in STAGES}
    return Measurement(objectives, stages, dict(report["device"]))


def _wait(process: subprocess.Popen[bytes], heartbeat: Callable[[], bool] | None, timeout: float) -> int:
    limit = time.monotonic() + timeout
    while True:
        left = limit - time.monotonic()
        if left <= 0:
            raise MeasurementError(f"no result after {timeout:g} s")
        try:
            return process.wait(min(HEARTBEAT_SECONDS, left))
        except subprocess.TimeoutExpired:
            if heartbeat is not None and not heartbeat():
                raise LeaseLostError from None


def _end(process: subprocess.Popen[bytes]) -> None:
    # The group, so that nothing the program started is left behind.
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _reason(code: int, errors: str) -> str:
    lines = errors.strip().splitlines()
    last = lines[-1] if lines else "nothing on its error output"
    if code < 0:
        with contextlib.suppress(ValueError):
            return f"killed by {signal.Signals(-code).name}: {last}"[:REASON_LENGTH]
    return f"exit code {code}: {last}"[:REASON_LENGTH]
