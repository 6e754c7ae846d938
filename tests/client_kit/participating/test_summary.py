"""What a participant is shown after a session."""

from collections.abc import Sequence
from typing import Any

import pytest
from msgspec.structs import replace

from client_kit.delivery.manifest import Manifest
from client_kit.device.sensors import Sample
from client_kit.measuring.session import Session
from client_kit.participating import summary
from tests.builders import manifests
from tests.client_kit import canned
from wire import session_statistics

ASKED = Manifest.parse(manifests.manifest())


def only(lines: list[str], words: str) -> str:
    """The one line in which `words` stand."""
    [line] = [line for line in lines if words in line]
    return line


def test_bars_show_default_above_best_for_each_stage() -> None:
    lines = summary.stages(canned.measured(ASKED), ASKED)

    title, *bars = lines[1:]
    assert title == "Mean time a frame, by stage"
    assert [line.split()[0] for line in bars[::2]] == [*canned.STAGES, "all"]
    assert [line.split()[0] for line in bars[1::2]] == ["best"] * 5
    total, fast = (line for line in bars[-2:])
    assert total.count("#") == summary.BAR
    assert fast.count("#") == summary.BAR // 4
    assert total.endswith("ms")
    assert 39 < float(total.split()[-2]) < 41
    assert 9 < float(fast.split()[-2]) < 11


def test_all_of_a_frame_is_its_time_where_the_device_times_only_the_stages() -> None:
    session = canned.measured(ASKED)
    runs = [replace(run, frame_us=[2 * time for time in run.frame_us]) for run in session.runs]

    *_, total, fast = summary.stages(replace(session, runs=tuple(runs)), ASKED)

    assert (total.count("#"), fast.count("#")) == (summary.BAR, summary.BAR // 4)
    assert 78 < float(total.split()[-2]) < 82
    assert 19 < float(fast.split()[-2]) < 21


def test_without_a_speedup_there_are_no_bars() -> None:
    session = canned.measured(ASKED, ("default", "default"))

    assert summary.stages(session, ASKED) == []


def slowed(session: Session, factor: float) -> Session:
    """`session` with the second half of its runs `factor` times slower."""
    half = len(session.runs) // 2
    slower = [
        replace(run, frame_us=[round(factor * time) for time in run.frame_us]) for run in session.runs[half:]
    ]
    return replace(session, runs=(*session.runs[:half], *slower))


def samples(temperatures: Sequence[float | None], clocks: Sequence[float | None]) -> list[Sample]:
    return [
        Sample(t=t, temperature_c=celsius, cpu_mhz=clock, battery=None)
        for t, (celsius, clock) in enumerate(zip(temperatures, clocks, strict=True))
    ]


@pytest.mark.parametrize(
    ("read", "why"),
    [
        ([], "the processor was slower for a while"),
        (samples([None] * 4, [None] * 4), "the processor was slower for a while"),
        (samples([60, 61, 62, 63], [3000, 3000, 2990, 2990]), "the processor was slower for a while"),
        (samples([55, 61, 80, 82], [3000, 3000, 2000, 2000]), "the device got hotter, from 58 to 81 °C"),
        (samples([None] * 4, [3100, 3100, 2300, 2300]), "the processor's clock fell from 3100 to 2300 MHz"),
    ],
)
def test_a_slowdown_says_what_was_read(read: list[Sample], why: str) -> None:
    session = replace(canned.measured(ASKED, ASKED.plan() * 2), samples=read)

    assert "longer" not in "".join(summary.figures(session, ASKED))
    line = only(summary.figures(slowed(session, 1.3), ASKED), "longer")
    assert line.startswith("The later runs of every configuration took 30 % longer")
    assert line.endswith(f": {why}.")


def test_a_slowdown_beside_other_programs_is_theirs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Session, "contended", lambda self, _: [self.runs[-1]])
    session = slowed(canned.measured(ASKED, ASKED.plan() * 2), 1.3)

    line = only(summary.figures(session, ASKED), "longer")

    assert line.endswith(": other programs used this processor.")


def test_one_slow_run_is_no_slowdown() -> None:
    session = canned.measured(ASKED, ASKED.plan() * 2)
    last = session.runs[-1]
    slower = replace(last, frame_us=[2 * time for time in last.frame_us])

    lines = summary.figures(replace(session, runs=(*session.runs[:-1], slower)), ASKED)

    assert "longer" not in "".join(lines)


def test_of_a_wide_interval_only_the_range_is_told() -> None:
    session = canned.measured(ASKED, ASKED.plan() * 2)
    runs = [
        replace(run, frame_us=[round(factor * time) for time in run.frame_us])
        for run, factor in zip(session.runs, (1, 1, 1, 3, 1, 1, 1, 3), strict=True)
    ]
    wide = replace(session, runs=tuple(runs))
    speedup = wide.speedup("best", ASKED)
    assert speedup is not None

    lines = summary.figures(wide, ASKED)

    line = only(lines, "Speedup of best over default: between ")
    assert f" {speedup.low:.2f} and {speedup.high:.2f}, the 95 % interval of 4 pairs of runs" in line
    assert f"{speedup.value:.2f}" not in "".join(lines)
    assert summary.best_speedup(wide, ASKED) is None


def test_the_speedup_is_reported_with_its_interval() -> None:
    lines = summary.figures(canned.measured(ASKED, ASKED.plan() * 2), ASKED)

    assert "4 pairs of runs, 95 % interval " in only(lines, "Speedup of best over default: ")


def test_a_disturbed_session_has_a_speedup_without_an_interval(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session_statistics, "MOST_WAITED", 0.7)
    session = canned.measured(ASKED, ASKED.plan() * 2)
    waiting = replace(session.runs[-1], cpu_us=1_000, waited_us=2_000)
    disturbed = replace(session, runs=(*session.runs[:-1], waiting))

    lines = summary.figures(disturbed, ASKED)

    assert only(lines, "Speedup of best over default: ").endswith("4 pairs of runs.")
    assert only(lines, "Other programs used this processor while best or default")


def test_beside_other_programs_processor_times_are_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session_statistics, "MOST_WAITED", 0.7)
    session = canned.measured(ASKED, ASKED.plan() * 2)
    runs = (
        replace(run, cpu_us=7_000 if run.configuration == "default" else 1_000, waited_us=9_000)
        for run in session.runs
    )

    lines = summary.figures(replace(session, runs=tuple(runs), on_processor=True), ASKED)

    assert only(lines, "Speedup of best over default, by processor time: between 5.2")
    assert only(lines, "Other programs used this processor, so processor times are compared")


def row(device: str, speedup: float, backend: str = "opencl") -> dict[str, Any]:
    return {"device": device, "speedup": speedup, "backend": backend}


def test_the_place_counts_each_other_device_once() -> None:
    crowd = [row("a", 9.0), row("a", 2.0), row("own", 8.0), row("b", 5.0), row("c", 3.0)]
    crowd.append(row("browser", 99.0, "webgpu"))

    line = summary.rank_line(crowd, 6.0, "own", "opencl")

    assert line == "Place 2 of 4 devices by speedup; half of the others gain 5.00 or more."
    assert summary.rank_line([row("own", 8.0)], 6.0, "own", "opencl").startswith("No other device")


def test_best_is_compared_with_the_crowd_else_the_fastest_that_counts() -> None:
    whole = canned.measured(ASKED)
    other = canned.measured(ASKED, ("default", "fine", "fine", "default"))
    alone = replace(whole, runs=whole.runs[:1])

    best, fine = summary.best_speedup(whole, ASKED), summary.best_speedup(other, ASKED)

    assert best is not None
    assert fine is not None
    assert (best[0], fine[0]) == ("best", "fine")
    assert summary.best_speedup(alone, ASKED) is None


def test_a_run_outside_its_band_is_said_not_to_count() -> None:
    run = canned.measured(ASKED).runs[1]
    near, far = (replace(run, deviation=deviation) for deviation in (0.002, 0.032))

    assert summary.run_lines(near, ASKED) == summary.run_lines(run, ASKED)
    _, line = summary.run_lines(far, ASKED)
    assert line.strip() == (
        "This device computes a different result (3.20 cm from the reference, 0.30 cm allowed), "
        "so the run does not count."
    )


def test_a_run_says_its_slowest_frames_and_how_many_it_left_out() -> None:
    run = canned.measured(ASKED).runs[1]
    count = ASKED.protocol.frames - ASKED.protocol.first_counted_frame
    times = [9_000] * ASKED.protocol.first_counted_frame + [2_000] * (count - 1) + [4_000]
    tracked = [None] * ASKED.protocol.first_counted_frame + [None, True] * (count // 2)
    adaptive = replace(run, frame_us=times, tracked=tracked)

    (line,) = summary.run_lines(adaptive, ASKED, adapts=True)

    assert "ms a frame (95 % within 3.30, longest 4.00), 50 % of frames skipped" in line
    assert "skipped" not in summary.run_lines(adaptive, ASKED)[0]
