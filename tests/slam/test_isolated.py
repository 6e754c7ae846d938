"""A measurement in a process of its own: whatever happens there ends as a value or as a reason."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from slam import isolated
from slam.datasets.formats.pack import Pack
from slam.isolated import (
    CannotMeasureHereError,
    LeaseLostError,
    Measurement,
    MeasurementError,
    combine,
    measure,
    read_report,
    worst,
)
from tests.slam.tiny import write_tiny_pack
from tests.waiting import PATIENCE_SECONDS, until
from wire.protocol import RUNTIMES

FAST = {"compute_size_ratio": 4, "volume_resolution": 32}


@pytest.fixture(scope="session")
def tiny_pack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_pack(tmp_path_factory.mktemp("sequences"))


@pytest.fixture(scope="module")
def decoded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("decoded")


@pytest.fixture(scope="module")
def measured(tiny_pack: Path, decoded: Path) -> Measurement:
    """A measurement that has decoded depth into an empty folder."""
    return measure("kfusion", FAST, [tiny_pack], decoded=decoded)


@pytest.mark.slow
def test_a_measurement_tells_time_error_stages_and_device(measured: Measurement) -> None:
    assert measured.objectives["runtime"] > 0
    assert 0 <= measured.objectives["ate_mean"] <= measured.objectives["ate_max"] < 1
    assert measured.stages["computation"] == pytest.approx(measured.objectives["runtime"])
    parts = [measured.stages[stage] for stage in ("preprocessing", "tracking", "integration", "raycasting")]
    assert 0 < sum(parts) <= measured.stages["computation"]
    assert measured.device["name"]


@pytest.mark.slow
def test_later_measurements_read_the_depth_that_the_first_one_decoded(
    tiny_pack: Path, measured: Measurement, decoded: Path
) -> None:
    written = {path: path.stat().st_mtime_ns for path in decoded.rglob("*.depth")}
    second = measure("kfusion", FAST, [tiny_pack], decoded=decoded)

    assert len(written) == len(Pack(tiny_pack))
    assert {path: path.stat().st_mtime_ns for path in decoded.rglob("*.*")} == written
    assert second.objectives["ate_max"] == measured.objectives["ate_max"]


@pytest.mark.slow
def test_what_cannot_run_is_a_failure_with_its_reason(tiny_pack: Path) -> None:
    with pytest.raises(MeasurementError, match=r"exit code 2: .*mu=-1\.0"):
        measure("kfusion", {"mu": -1.0}, [tiny_pack])


@pytest.mark.slow
def test_without_its_device_a_machine_can_measure_nothing(tiny_pack: Path) -> None:
    with pytest.raises(CannotMeasureHereError, match="no OpenCL device matches 'abacus'"):
        measure("kfusion", FAST, [tiny_pack], device="abacus")


def test_where_no_process_can_be_started_nothing_is_measured(
    tiny_pack: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(isolated, "PROGRAM", (str(tmp_path / "no such program"),))
    with pytest.raises(CannotMeasureHereError, match=r"no process can be started: .*no such program"):
        measure("kfusion", FAST, [tiny_pack])


def test_a_measurement_that_takes_too_long_is_ended(tiny_pack: Path) -> None:
    with pytest.raises(MeasurementError, match=r"no result after 0\.01 s"):
        measure("kfusion", FAST, [tiny_pack], timeout=0.01)


def test_a_measurement_that_nobody_waits_for_is_ended(tiny_pack: Path) -> None:
    with pytest.raises(LeaseLostError):
        measure("kfusion", FAST, [tiny_pack], heartbeat=lambda: False, heartbeat_seconds=0.01)


def test_a_sequence_without_truth_teaches_nothing() -> None:
    with pytest.raises(MeasurementError, match="no true trajectory"):
        read_report({"ate": None})


def test_a_report_of_no_frame_is_no_measurement() -> None:
    with pytest.raises(MeasurementError, match="no frame"):
        read_report({"ate": {"max": 0.1}, "frames": [], "runtime": 0.1})


@pytest.mark.slow
def test_only_the_wanted_frames_are_run(tiny_pack: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[dict[str, Any]] = []
    monkeypatch.setattr(isolated, "read_report", lambda report, _: seen.append(report))

    measure("kfusion", FAST, [tiny_pack], frames=11)

    assert len(seen[0]["frames"]) == 11


@pytest.mark.slow
def test_several_sequences_are_measured_in_turn_until_one_fails(tiny_pack: Path, tmp_path: Path) -> None:
    other = write_tiny_pack(tmp_path, name="other")

    whole = measure("kfusion", FAST, [tiny_pack, other], perturbation=1)
    early = measure("kfusion", FAST, [tiny_pack, other], stop_above=[{"ate_max": 0.0}])

    assert [part["sequence"] for part in whole.parts] == ["tiny", "other"]
    assert [part["sequence"] for part in early.parts] == ["tiny"]
    assert whole.objectives["ate_max"] == max(part["ate_max"] for part in whole.parts)
    assert whole.objectives["runtime"] == pytest.approx(sum(part["runtime"] for part in whole.parts) / 2)
    assert whole.parts[0]["ate_max"] == whole.parts[1]["ate_max"]
    assert whole.parts[0]["lost"] == whole.parts[1]["lost"] <= 12


def part(name: str, **values: float) -> dict[str, Any]:
    return {"sequence": name, "lost": 0, **values}


def test_of_several_sequences_the_largest_error_frame_and_memory_and_the_mean_of_the_rest_count() -> None:
    parts = [
        part("a", ate_max=0.1, runtime=0.2, runtime_max=0.8, peak_memory_bytes=5, energy_joules=1),
        part("b", ate_max=0.3, runtime=0.4, runtime_max=0.6, peak_memory_bytes=9),
    ]
    expected = {"ate_max": 0.3, "runtime": pytest.approx(0.3), "runtime_max": 0.8, "peak_memory_bytes": 9}
    assert combine(parts) == expected
    assert combine(parts, ignored=1) == expected | {"ate_max": 0.1}


@pytest.mark.parametrize(("ignored", "expected"), [(0, 3.0), (1, 2.0), (2, 1.0), (5, 1.0)])
def test_the_worst_of_values_but_for_some(ignored: int, expected: float) -> None:
    assert worst([1.0, 3.0, 2.0], ignored) == expected


def report(name: str, tracked: list[bool | None], ate: float = 0.01) -> dict[str, Any]:
    frames = [dict.fromkeys(isolated.STAGES, 0.1) | {"tracked": frame} for frame in tracked]
    return {
        "sequence": {"name": name},
        "ate": {"max": ate},
        "valid": True,
        "not_valid_because": None,
        "frames": frames,
        **dict.fromkeys(RUNTIMES, 0.1),
        "cpu_seconds": 0.1,
        "waited_us": 3_000,
        "peak_memory_bytes": None,
        "energy_joules": None,
        "device": {"name": "Bench CPU"},
    }


def test_a_report_of_several_sequences_has_a_part_of_each() -> None:
    read = read_report({"runs": [report("a", [None, True, True]), report("b", [True, False, True], 0.02)]})

    assert [(part["sequence"], part["lost"], part["ate_max"]) for part in read.parts] == [
        *(("a", 0, 0.01), ("b", 1, 0.02))
    ]
    assert read.objectives["ate_max"] == 0.02
    assert (read.objectives["cpu_seconds"], read.objectives["waited_seconds"]) == pytest.approx(
        (1 / 30, 0.001)
    )
    assert read.stages["computation"] == pytest.approx(0.1)
    assert read.device == {"name": "Bench CPU"}


def test_a_failure_names_the_sequence() -> None:
    with pytest.raises(MeasurementError, match=r"^b: tracking lost in 3 of 3 frames"):
        read_report({"runs": [report("a", [True] * 3), report("b", [False] * 3)]})


def test_a_camera_lost_on_a_held_out_sequence_is_a_result() -> None:
    lost = report("b", [True, False, False], 0.02)
    lost["frames"] = [frame | {"computation": 0.7} for frame in lost["frames"]]

    read = read_report({"runs": [report("a", [True] * 3), lost]}, learned_on=1)

    assert [(part["sequence"], part["lost"]) for part in read.parts] == [("a", 0), ("b", 2)]
    assert read.objectives["ate_max"] == 0.01
    assert read.stages["computation"] == pytest.approx(0.1)  # as the runtime, of those learned on


def test_a_held_out_sequence_of_which_no_frame_is_tracked_is_lost() -> None:
    read = read_report({"runs": [report("a", [True] * 3), report("b", [None] * 3)]}, learned_on=1)

    assert read.parts[1]["lost"] == 3


def test_each_sequence_has_the_time_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program(monkeypatch, "import time; time.sleep(60)")
    with pytest.raises(MeasurementError, match=r"no result after 0\.2 s"):
        measure("kfusion", FAST, [tmp_path, tmp_path], timeout=0.1)


def program(monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    """`script` runs in place of slam; its last argument is where the report belongs."""
    monkeypatch.setattr(isolated, "PROGRAM", (sys.executable, "-c", script))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("import os; os.abort()", "killed by SIGABRT: nothing on its error output"),
        ("import os; os.kill(os.getpid(), 9)", "killed by SIGKILL .as the system does when memory runs out"),
        (
            "raise SystemExit('bell \\a, NUL \\0 and \\x1b[1m bold')",
            r"^exit code 1: bell , NUL and \[1m bold$",
        ),
        ("raise MemoryError('no buffer of 512 MiB')", "exit code 1: MemoryError: no buffer of 512 MiB"),
        ("pass", "the report cannot be read: FileNotFoundError"),
        ("import sys; open(sys.argv[-1], 'w').write('<html>')", "the report cannot be read: JSONDecodeError"),
        ("import sys; open(sys.argv[-1], 'w').write('[]')", "the report cannot be read: AttributeError"),
        ("import sys; open(sys.argv[-1], 'w').write('{}')", "the report cannot be read: KeyError"),
    ],
)
def test_a_program_that_breaks_is_a_failure_with_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, reason: str
) -> None:
    program(monkeypatch, script)
    with pytest.raises(MeasurementError, match=reason):
        measure("kfusion", FAST, [tmp_path], timeout=PATIENCE_SECONDS)


def test_values_that_are_not_finite_are_no_measurement() -> None:
    with pytest.raises(MeasurementError, match="ate_max is nan"):
        read_report(report("a", [True], float("nan")))


@pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="Linux alone tells a child that its parent died"
)
def test_killing_the_one_who_measures_ends_what_it_started(tmp_path: Path) -> None:
    pid = tmp_path / "pid"
    child = f"import os, time; open({str(pid)!r}, 'w').write(str(os.getpid())); time.sleep(600)"
    worker = f"""
import sys
from pathlib import Path
from slam import isolated
isolated.PROGRAM = (sys.executable, "-c", {child!r})
isolated.measure("kfusion", {json.dumps(FAST)}, [Path(".")])
"""
    process = subprocess.Popen([sys.executable, "-c", worker])
    measuring = int(until(lambda: pid.exists() and pid.read_text()))

    os.kill(process.pid, signal.SIGKILL)
    process.wait()

    until(lambda: not _runs(measuring))


def _runs(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"  # its new parent has not collected it yet
