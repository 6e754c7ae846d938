"""What a driver, the system or the participant does to the process that measures, and what is kept then."""

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from client_kit.delivery.manifest import Manifest
from client_kit.errors import CannotMeasureError
from client_kit.measuring import measurement, worker_client
from client_kit.measuring.measurement import Task, measure
from client_kit.measuring.session import Run, Session, payload
from client_kit.measuring.worker_client import COMPILING_MINUTES, Outcome, Progress
from tests.builders import manifests
from tests.client_kit.breaking import (
    BROKEN,
    COMPILER,
    EMPTY_FRAME,
    EMPTY_FRAME_SECONDS,
    FRAMES_BEFORE_THE_END,
    GONE,
    ONCE,
    POSITION,
    STEPS,
    UNREADABLE,
    report,
)
from tests.client_kit.observing import Calling
from wire import session_statistics

CONFIGURATIONS: dict[str, dict[str, Any]] = {
    "default": {},
    "best": {},
    "aborting": {"ends": "abort"},
    "killed": {"ends": "kill"},
    "hanging": {"ends": "hang"},
    "failing": {"fails": "RuntimeError: CL_OUT_OF_RESOURCES"},
    "closing": {"ends": "close"},
    "fatal": {"ends": "abort", "for_good": True},
    "last": {"ends": "abort", "takes_away": True},
    "unreadable": {"unreadable": True},
}
DEVICE: Any = SimpleNamespace(label="a GPU", backend="opencl", kind="gpu", threads=None)
ABORTED = "killed by SIGABRT: LLVM ERROR: Cannot select kernel.cl"
KILLED = "killed by SIGKILL (as the system does when memory runs out): nothing on its error output"
LAST_BEFORE_IT_HANGS = ("hanging, run 3 of 6", FRAMES_BEFORE_THE_END)
# 1 mm from what BreakingWorker computes.
REFERENCES = dict.fromkeys(CONFIGURATIONS, [(2.4, 2.4, 0.501)] * manifests.FRAMES)
HUNG = "no answer from the device within 1 s"

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="this platform has no signals to end by")


@pytest.fixture(autouse=True)
def breaking(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(worker_client, "PROGRAM", (sys.executable, "-m", "tests.client_kit.breaking"))
    monkeypatch.setenv(BROKEN, str(tmp_path / "broken"))
    monkeypatch.setattr(measurement, "open_sequence", lambda _: range(100))


def measured(
    *plan: str,
    protocol: dict[str, Any] | None = None,
    impossible: dict[str, str] | None = None,
    compiling_minutes: int = COMPILING_MINUTES,
    **calls: Callable[..., Any],
) -> tuple[Session, bool]:
    """The session of `plan`, and whether it was interrupted."""
    members = {
        "configurations": [
            manifests.configuration(name, parameters) for name, parameters in CONFIGURATIONS.items()
        ],
        "protocol": manifests.manifest()["protocol"] | (protocol or {}),
    }
    asked = Manifest.parse(manifests.manifest(**members))
    task = Task(asked, plan, Path("sequence"), REFERENCES, impossible or {})
    return measure(task, DEVICE, Calling(**calls), compiling_minutes=compiling_minutes)


def session(*plan: str, **wishes: Any) -> Session:
    return measured(*plan, **wishes)[0]


class Tireless:
    """A worker in this process, with which every run takes a little longer than the one before."""

    def __init__(self, *_: Any) -> None:
        self._runs = 0

    def __enter__(self) -> "Tireless":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def empty_frame_seconds(self) -> float:
        return EMPTY_FRAME_SECONDS

    def measure(self, _: Mapping[str, Any], frames: int, first: int, between_frames: Progress) -> Outcome:
        assert 0 <= first <= frames
        self._runs += 1
        for frame in range(frames):
            between_frames(frame + 1, frames)
        return Outcome(report(frames, 0.04 + 0.001 * self._runs**2), POSITION * frames)


@pytest.fixture
def tireless(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measurement, "WorkerClient", Tireless)


def outcomes(session: Session) -> list[tuple[str, str | None]]:
    return [(run.configuration, run.failure) for run in session.runs]


@pytest.mark.slow
def test_a_driver_that_aborts_hangs_or_is_killed_fails_its_configuration_and_the_others_go_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    patience = worker_client.LONGEST_FRAME_SECONDS

    def wait_at_most(seconds: int) -> None:
        monkeypatch.setattr(worker_client, "LONGEST_FRAME_SECONDS", seconds)

    done = session(
        "default", "aborting", "hanging", "killed", "failing", "default",
        on_frame=lambda run, done, *_: wait_at_most(1 if (run, done) == LAST_BEFORE_IT_HANGS else patience),
        on_run=lambda _: wait_at_most(patience),
    )  # fmt: skip

    assert outcomes(done) == [
        ("default", None),
        ("aborting", ABORTED),
        ("hanging", HUNG),
        ("killed", KILLED),
        ("failing", "RuntimeError: CL_OUT_OF_RESOURCES"),
        ("default", None),
    ]
    assert [run.status for run in done.runs] == ["ok", *["failed"] * 4, "ok"]


@pytest.mark.slow
def test_what_broke_a_process_is_not_tried_again_and_the_next_one_is_warmed_up_first() -> None:
    frames: list[tuple[str, int]] = []

    done = session(
        "default", "aborting", "aborting", "default",
        protocol={"warmup_frames": 2},  # one less than it takes to break
        on_frame=lambda label, done, *_: frames.append((label, done)),
    )  # fmt: skip

    assert outcomes(done) == [("default", None), *[("aborting", ABORTED)] * 2, ("default", None)]
    labels = list(dict.fromkeys(label for label, _ in frames))
    assert labels == [
        "warm-up, default", "warm-up, aborting",
        "default, run 1 of 4", "aborting, run 2 of 4", "default, run 4 of 4",
    ]  # fmt: skip
    assert [done for label, done in frames if label == "warm-up, default"] == [1, 2, 1, 2]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plan", "reasons"),
    [
        (("default", "fatal", "best", "default"), [ABORTED] * 3),  # it is gone for good
        (("default", "last", "best", "default"), [ABORTED, GONE, GONE]),  # it was taken away
        (("default", "unreadable", "best"), [UNREADABLE] * 2),  # the sequence cannot be read any more
    ],
    ids=lambda value: value[1] if isinstance(value, tuple) else "",
)
def test_without_a_device_or_sequence_what_follows_fails_and_what_was_measured_is_kept(
    plan: tuple[str, ...], reasons: list[str]
) -> None:
    done = session(*plan, protocol={"warmup_frames": 0})

    assert outcomes(done) == list(zip(plan, [None, *reasons], strict=True))
    assert done.runs[0].status == "ok"


@pytest.mark.slow
def test_a_sequence_that_cannot_be_read_from_the_start_measures_nothing() -> None:
    with pytest.raises(CannotMeasureError, match=UNREADABLE):
        session("unreadable", "best", protocol={"warmup_frames": 0})


def test_a_machine_that_starts_no_process_says_so_and_keeps_what_was_measured(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def start_no_further(_: Any = None) -> None:
        monkeypatch.setattr(worker_client, "PROGRAM", ("/nowhere/python",))

    done = session("default", "aborting", "best", protocol={"warmup_frames": 0}, on_run=start_no_further)

    assert [run.status for run in done.runs] == ["ok", "failed", "failed"]
    assert "no process can be started to measure in" in str(done.runs[2].failure)
    with pytest.raises(CannotMeasureError, match="no process can be started to measure in"):
        session("default")


@pytest.mark.slow
def test_a_process_that_closes_its_output_and_goes_on_is_not_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def impatient(label: str, done: int, *_: Any) -> None:
        if (label, done) == ("closing, run 1 of 1", FRAMES_BEFORE_THE_END):
            monkeypatch.setattr(worker_client, "LONGEST_FRAME_SECONDS", 1)

    done = session("closing", protocol={"warmup_frames": 0}, on_frame=impatient)

    assert outcomes(done) == [("closing", HUNG)]


@pytest.mark.usefixtures("tireless")
def test_between_runs_the_device_rests_as_the_protocol_says() -> None:
    rests: list[float] = []

    session("default", "best", protocol={"rest_seconds": 7.5}, rest=rests.append)

    assert rests == [7.5]


@pytest.mark.usefixtures("tireless")
def test_what_is_known_not_to_fit_is_recorded_and_never_tried() -> None:
    seen: list[str] = []
    reason = "volume_resolution=512 needs 640 MiB"

    done = session(
        "default", "best", impossible={"best": reason}, on_frame=lambda name, *_: seen.append(name)
    )

    assert outcomes(done) == [("default", None), ("best", reason)]
    assert not [label for label in seen if "best" in label]


def test_ctrl_c_keeps_the_runs_that_are_finished() -> None:
    def interrupt(label: str, done: int, *_: Any) -> None:
        if label == "best, run 3 of 4" and done == 5:
            raise KeyboardInterrupt

    done, interrupted = measured("default", "best", "best", "default", on_frame=interrupt)

    assert interrupted
    assert outcomes(done) == [("default", None), ("best", None)]


@pytest.mark.usefixtures("tireless")
def test_ctrl_c_before_the_first_run_is_over_leaves_nothing() -> None:
    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        session("default", on_frame=interrupt)


class Disturbed(Tireless):
    """A worker whose runs of these numbers, from 1, other programs disturb: its threads wait."""

    numbers: frozenset[int] = frozenset()

    def measure(self, _: Mapping[str, Any], frames: int, first: int, between_frames: Progress) -> Outcome:
        outcome = super().measure(_, frames, first, between_frames)
        waited = 4_000_000 if self._runs in self.numbers else 0
        return replace(outcome, cpu_us=1_000_000, waited_us=waited)


def disturb(monkeypatch: pytest.MonkeyPatch, *numbers: int) -> None:
    monkeypatch.setattr(session_statistics, "MOST_WAITED", 0.85)
    # Two frames of each configuration warm up before the first run.
    worker = type("Here", (Disturbed,), {"numbers": frozenset(2 + number for number in numbers)})
    monkeypatch.setattr(measurement, "WorkerClient", worker)


def test_a_block_that_other_programs_disturb_is_measured_again(monkeypatch: pytest.MonkeyPatch) -> None:
    disturb(monkeypatch, 2)
    announced: list[bool] = []
    plan = ("default", "best", "best", "default") * 2

    done = session(*plan, on_contention=lambda: announced.append(True))

    assert announced == [True]
    assert done.blocks_repeated == 1
    assert [run.order for run in done.runs] == list(range(4, 12))
    assert [(run.configuration, run.repeat) for run in done.runs[4:]] == [
        ("default", 0), ("best", 0), ("best", 1), ("default", 1),
    ]  # fmt: skip


def test_a_machine_that_stays_busy_is_measured_again_twice_and_the_runs_say_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    disturb(monkeypatch, *range(1, 100))

    done = session("default", "best", "best", "default")

    assert (done.blocks_repeated, len(done.runs)) == (2, 4)
    document = payload(done, Manifest.parse(manifests.manifest()), {})["sessions"][0]
    assert document["blocks_repeated"] == 2
    assert {run["waited_us"] for run in document["runs"]} == {4_000_000}


def test_ctrl_c_while_a_block_is_measured_again_keeps_the_first_one(monkeypatch: pytest.MonkeyPatch) -> None:
    disturb(monkeypatch, 1)

    def interrupt(label: str, *_: Any) -> None:
        if label == "best, measured again":
            raise KeyboardInterrupt

    done, interrupted = measured("default", "best", "best", "default", on_frame=interrupt)

    assert interrupted
    assert [run.order for run in done.runs] == [0, 1, 2, 3]


def test_an_empty_frame_is_measured_and_each_run_compared_with_its_reference() -> None:
    done = session("default", "best", "aborting")

    assert done.empty_frame_us == pytest.approx(1e6 * EMPTY_FRAME_SECONDS)
    assert done.stage_clock == "device"
    assert [run.deviation for run in done.runs] == [pytest.approx(0.001), pytest.approx(0.001), None]


@pytest.mark.slow
def test_a_device_that_does_not_run_an_empty_frame_measures_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(EMPTY_FRAME, "abort")

    with pytest.raises(CannotMeasureError, match=f"nothing can be measured here: {ABORTED}"):
        session("default")


@pytest.mark.parametrize("moment", [pytest.param("an empty frame", marks=pytest.mark.slow), "before it"])
def test_a_device_that_breaks_its_process_once_is_opened_once_more(
    moment: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    if moment == "before it":
        (tmp_path / "broken").write_text(ONCE)
    else:
        monkeypatch.setenv(EMPTY_FRAME, "abort once")

    done = session("default")

    assert done.empty_frame_us == pytest.approx(1e6 * EMPTY_FRAME_SECONDS)
    assert outcomes(done) == [("default", None)]


@pytest.mark.usefixtures("tireless")
def test_a_session_follows_its_plan_and_progress_counts_the_runs() -> None:
    labels: list[str] = []

    done = session("default", "best", "best", "default", on_frame=lambda label, *_: labels.append(label))

    assert [(run.configuration, run.repeat) for run in done.runs] == [
        ("default", 0), ("best", 0), ("best", 1), ("default", 1),
    ]  # fmt: skip
    assert list(dict.fromkeys(labels)) == [
        "warm-up, default", "warm-up, best",
        "default, run 1 of 4", "best, run 2 of 4", "best, run 3 of 4", "default, run 4 of 4",
    ]  # fmt: skip


@pytest.mark.slow
def test_a_compiler_slower_than_any_frame_breaks_nothing_and_reports_its_steps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shown: list[tuple[str, int, int]] = []
    patience = worker_client.LONGEST_FRAME_SECONDS

    def wait_for_frames(allowed: bool) -> None:
        """While it compiles, any wait for a frame would be too long."""
        monkeypatch.setattr(worker_client, "LONGEST_FRAME_SECONDS", patience if allowed else 0)

    def watch(label: str, done: int, total: int, _left: float | None) -> None:
        shown.append((label, done, total))
        wait_for_frames("run 1" in label)

    wait_for_frames(False)
    monkeypatch.setenv(COMPILER, "reports")

    done = session("default", protocol={"warmup_frames": 0}, on_frame=watch)

    assert outcomes(done) == [("default", None)]
    assert [line for line in shown if line[0] == "trying kernel layouts"] == [
        ("trying kernel layouts", number, STEPS) for number in range(STEPS + 1)
    ]
    assert ("compiling for this device", 0, 1) in shown


@pytest.mark.slow
@pytest.mark.parametrize(
    ("backend", "remedy"),
    [
        ("opencl", "--compiling-minutes 2, or measure the processor with --backend wasm"),
        ("wasm", "--compiling-minutes 2"),
    ],
)
def test_a_compiler_that_never_answers_ends_at_its_limit_once_and_the_message_says_what_to_try(
    monkeypatch: pytest.MonkeyPatch, backend: str, remedy: str
) -> None:
    monkeypatch.setenv(COMPILER, "hangs")
    monkeypatch.setattr(DEVICE, "backend", backend)
    opened: list[int] = []

    def watch(_: str, done: int, *_rest: Any) -> None:
        opened.append(done)
        monkeypatch.setattr(worker_client, "MINUTE", 1)

    with pytest.raises(CannotMeasureError, match=f"did not answer within 1 min: .*{remedy}$"):
        session("default", compiling_minutes=1, on_frame=watch)

    assert opened == [0]


@pytest.mark.slow
def test_what_was_measured_before_the_compiler_hung_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(COMPILER, "reports")
    runs: list[str] = []

    def watch(label: str, *_: Any) -> None:
        hangs = label == "compiling for this device" and len(runs) == 1
        monkeypatch.setattr(worker_client, "MINUTE", 1 if hangs else 60)

    def on_run(run: Run) -> None:
        runs.append(run.configuration)
        monkeypatch.setattr(worker_client, "MINUTE", 60)

    done = session(
        "default", "hanging", "default",
        protocol={"warmup_frames": 0}, compiling_minutes=1, on_frame=watch, on_run=on_run,
    )  # fmt: skip

    assert [run.status for run in done.runs] == ["ok", "failed", "ok"]
    assert "--compiling-minutes 2" in str(done.runs[1].failure)
