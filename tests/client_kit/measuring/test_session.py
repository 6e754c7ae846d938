"""What the runs of a session come to: speedups with intervals, drift, how long it takes."""

import math
import uuid
from collections.abc import Sequence
from typing import Any

import pytest
from msgspec.structs import replace
from scipy import stats

from client_kit.delivery.manifest import Manifest
from client_kit.measuring.schedule import Schedule
from client_kit.measuring.session import Run, Session, begin, payload
from tests.builders import manifests
from wire.session import Sample

ASKED = Manifest.parse(manifests.manifest())


def run_of(
    configuration: str, repeat: int, milliseconds: Sequence[float], ate_max: float | None = 0.01
) -> Run:
    times = [round(1000 * time) for time in milliseconds]
    return Run(uuid.uuid4(), configuration, repeat, 0, "ok", frame_us=times, ate_max=ate_max)


def session_of(*runs: Run) -> Session:
    session = begin(ASKED, "opencl", None)
    return replace(session, runs=runs, empty_frame_us=212.5, stage_clock="device")


def pairs(*milliseconds: tuple[float, float], name: str = "best") -> list[Run]:
    """Runs of the default and of `name`, a repeat for each pair of mean times."""
    runs = []
    for repeat, (base, other) in enumerate(milliseconds):
        runs += [run_of("default", repeat, [base] * 12), run_of(name, repeat, [other] * 12)]
    return runs


def value(session: Session) -> float:
    speedup = session.speedup("best", ASKED)
    assert speedup is not None
    return speedup.value


def test_the_speedup_is_the_geometric_mean_of_the_paired_ratios() -> None:
    session = session_of(
        run_of("default", 0, [900] * 4 + [40] * 8),
        run_of("best", 0, [900] * 4 + [10] * 8),
        run_of("best", 1, [900] * 4 + [20] * 8),
        run_of("default", 1, [900] * 4 + [180] * 8),
    )

    assert value(session) == pytest.approx(math.sqrt((40 / 10) * (180 / 20)))


def test_work_done_in_few_frames_counts_in_full() -> None:
    session = session_of(run_of("default", 0, [10] * 12), run_of("best", 0, [1] * 4 + [33] + [1] * 7))

    assert value(session) == pytest.approx(10 / 5)


@pytest.mark.parametrize("ate_max", [0.05, 3.0, None])
def test_a_run_whose_trajectory_is_off_makes_no_speedup(ate_max: float | None) -> None:
    base = run_of("default", 0, [40] * 12)
    bad, good = run_of("best", 0, [10] * 12, ate_max), run_of("best", 1, [20] * 12)

    assert session_of(base, bad).speedup("best", ASKED) is None
    assert value(session_of(base, bad, good, run_of("default", 1, [40] * 12))) == pytest.approx(2)


def test_the_interval_is_students_t_over_the_pairs() -> None:
    times = [(40, 10), (41, 10), (39, 10.5), (40, 9.9)]
    logs = [math.log(base / other) for base, other in times]

    speedup = session_of(*pairs(*times)).speedup("best", ASKED)

    mean = sum(logs) / len(logs)
    low, high = stats.t.interval(0.95, 3, loc=mean, scale=stats.sem(logs))

    assert speedup is not None
    assert (speedup.pairs, speedup.value) == (4, pytest.approx(math.exp(mean), rel=1e-4))
    assert (speedup.low, speedup.high) == pytest.approx((math.exp(low), math.exp(high)), rel=1e-3)


@pytest.mark.parametrize("count", [1, 2])
def test_too_few_pairs_have_no_interval(count: int) -> None:
    speedup = session_of(*pairs(*[(40, 10), (41, 10)][:count])).speedup("best", ASKED)

    assert speedup is not None
    assert (speedup.pairs, speedup.low, speedup.high) == (count, None, None)


def test_a_slowdown_is_that_of_the_runs_in_the_order_measured() -> None:
    # The last block was measured again: its runs stand where the disturbed ones stood.
    runs = pairs((40, 10), (41, 10), (52, 13), (52, 13))
    ordered = [replace(run, order=order) for order, run in enumerate(runs)]

    assert session_of(*ordered).slowed_down(ASKED.protocol) == pytest.approx(1.29, abs=0.01)
    assert session_of(*ordered[4:], *ordered[:4]).slowed_down(ASKED.protocol) == pytest.approx(1.29, abs=0.01)
    failed = [replace(run, status="failed") for run in ordered[6:]]
    assert session_of(*ordered[:6], *failed).slowed_down(ASKED.protocol) is None


def test_the_time_left_counts_what_each_configuration_took() -> None:
    now = [0.0]
    schedule = Schedule(rest_seconds=1.0, now=lambda: now[0])
    schedule.add(["default", "best"], 10)
    schedule.add(["default", "best"], 100)

    schedule.begin()
    now[0] = 2.0  # 4 frames of the default's warm-up took 2 s
    assert schedule.left(0) is None
    # 6 frames of it, best (as slow as the slowest so far), both runs, and three rests.
    assert schedule.left(4) == pytest.approx(6 * 0.5 + 10 * 0.5 + 100 * 0.5 + 100 * 0.5 + 3)
    schedule.end()
    schedule.begin()
    now[0] = 2.5
    assert schedule.left(10) == pytest.approx(100 * 0.5 + 100 * 0.05 + 2)


def sent(run: Run, **session: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """A session of `run` and its run, as they are sent."""
    document = payload(replace(session_of(run), **session), ASKED, {})["sessions"][0]
    return document, document["runs"][0]


MEASURED = replace(run_of("best", 0, [10] * 12), stages_us={"tracking": [9] * 12})


def test_what_was_measured_of_a_run_is_sent_and_the_clock_of_its_stages() -> None:
    session, run = sent(replace(MEASURED, deviation=0.0004))
    assert session["protocol_version"] == 2
    assert (session["stage_clock"], session["empty_frame_us"]) == ("device", 212.5)
    assert (run["deviation"], run["stages_us"]) == (0.0004, {"tracking": [9] * 12})

    session, run = sent(replace(MEASURED, stages_us={}, deviation=0.0), stage_clock="none")
    assert (session["stage_clock"], "stages_us" in run) == ("none", False)

    _, failed = sent(Run(uuid.uuid4(), "best", 0, 0, "failed", [], failure="out of memory"))
    assert ("deviation" in failed, "stages_us" in failed) == (False, False)


def test_a_run_that_leaves_its_band_makes_no_speedup() -> None:
    base, other = pairs((40, 10))
    near, far = (replace(other, deviation=deviation) for deviation in (0.003, 0.0031))

    assert value(session_of(base, near)) == pytest.approx(4)
    assert session_of(base, far).speedup("best", ASKED) is None


def test_a_long_session_sends_as_many_samples_as_a_server_takes() -> None:
    samples = [Sample(float(second), None, None, None) for second in range(12_000)]
    long = replace(session_of(), samples=samples)

    sent = payload(long, ASKED, {})["sessions"][0]["samples"]

    assert len(sent) == 4_000
    assert [sample["t"] for sample in sent[:3]] == [0.0, 3.0, 6.0]
