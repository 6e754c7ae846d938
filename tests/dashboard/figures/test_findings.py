"""Titles of charts: true for no row, one, two, all slower, ties."""

from collections.abc import Sequence
from datetime import UTC, datetime
from statistics import fmean
from typing import Any

import pytest

from crowd.dashboard.content.drift import Readings, Step
from crowd.dashboard.content.stages import StageSpread, StageTimes
from crowd.dashboard.figures import findings
from crowd.records.session import SessionSpeedup
from crowd.results.reading.queries.filters import SpeedupFilters
from crowd.results.reading.rows import History, ModelOutcomes, Release
from crowd.results.reading.transferring.rows import Winners
from tests.builders.rows import crowd, speedup


def plain(words: str) -> str:
    for sign, letter in (("\N{MULTIPLICATION SIGN}", "x"), ("\N{NO-BREAK SPACE}", " "), ("\N{EN DASH}", "-")):
        words = words.replace(sign, letter)
    return words.replace("\N{NARROW NO-BREAK SPACE}", " ")


@pytest.mark.parametrize(
    ("speedups", "uncounted", "words"),
    [
        ([], 0, "No device has been measured yet"),
        ([], 1, "One device was measured, and its figure is not confirmed yet"),
        ([], 4, "None of 4 devices has a confirmed figure yet"),
        ([4.1], 0, "One device so far: best is 4.10x faster than the default"),
        ([0.5], 3, "One confirmed device so far: best is 0.500x as fast as the default"),
        ([1.0], 0, "One device so far: best is 1.00x as fast as the default"),
        ([3.0, 5.0], 0, "Both devices are faster with best: 5.00x and 3.00x"),
        ([3.0, 0.5], 0, "1 of 2 devices is faster with best: 3.00x and 0.500x"),
        ([0.5, 0.5], 0, "Neither of two devices is faster with best: 0.500x and 0.500x"),
        ([2.0, 4.0, 6.0], 9, "Every one of 3 devices is faster with best: 4.00x in the mean"),
        ([0.5, 2.0, 4.0], 0, "2 of 3 devices are faster with best: 2.17x in the mean"),
        ([0.5, 0.5, 4.0], 0, "1 of 3 devices is faster with best: 1.67x in the mean"),
        ([0.5, 0.6, 0.7], 0, "None of 3 devices is faster with best: 0.600x in the mean"),
        ([1.0, 1.0, 1.0], 0, "None of 3 devices is faster with best: 1.00x in the mean"),
    ],
)
def test_the_crowd(speedups: Sequence[float], uncounted: int, words: str) -> None:
    mean = fmean(speedups) if speedups else None

    assert plain(findings.crowd(speedups, mean, "best", uncounted)) == words


def test_the_crowd_names_the_configuration() -> None:
    words = findings.crowd([2.0, 3.0, 4.0], 3.0, "accurate")

    assert plain(words) == "Every one of 3 devices is faster with accurate: 3.00x in the mean"


@pytest.mark.parametrize(
    ("failing", "ending"),
    [
        (0, "5.00x and 3.00x"),
        (1, "5.00x and 3.00x; best did not finish on 1 of 3 tried from enough networks"),
    ],
)
def test_the_crowd_says_where_the_configuration_failed(failing: int, ending: str) -> None:
    outcomes = ModelOutcomes(devices=3, failing=failing, losing=0)
    words = findings.crowd([3.0, 5.0], 4.0, "best", outcomes=outcomes)

    assert plain(words) == f"Both devices are faster with best: {ending}"


@pytest.mark.parametrize(
    ("wins", "judged", "regret", "words"),
    [
        (0, 0, None, "No device has a valid figure of best to compare yet"),
        (1, 1, 1.0, "On the one device best is the fastest configuration"),
        (0, 1, 1.2, "On the one device best takes 1.20x the time of the fastest"),
        (3, 3, 1.0, "On all of 3 devices best is the fastest configuration"),
        (0, 3, 1.5, "On none of 3 devices best is the fastest: in the median it takes 1.50x the time"),
        (9, 62, 1.1, "On 9 of 62 devices best is the fastest: in the median it takes 1.10x the time"),
    ],
)
def test_the_fastest_of_the_reference(wins: int, judged: int, regret: float | None, words: str) -> None:
    found = Winners(SpeedupFilters(), "front", "best", (), (), judged, wins, regret, None, 0)
    assert plain(findings.regret(found)) == words


@pytest.mark.parametrize(
    ("counts", "words"),
    [
        ([], "No device has measured several configurations yet"),
        ([("best", 1)], "On the one device best is the fastest"),
        ([("fast", 5), ("best", 2)], "On 5 of 7 devices fast is the fastest"),
        ([("a", 2), ("b", 2)], "Two configurations, a and b, are each the fastest on 2 of 4 devices"),
        ([("a", 1), ("b", 1), ("c", 1)], "3 configurations are each the fastest on 1 of 3 devices"),
    ],
)
def test_winners(counts: list[tuple[str, int]], words: str) -> None:
    assert plain(findings.winners(counts, sum(count for _, count in counts))) == words


def test_alike_devices() -> None:
    assert findings.alike([], "pearson") == "No two devices can be compared yet"
    assert (
        findings.alike([0.5], "spearman") == "Times correlate with 0.50 (Spearman) on the one pair of devices"
    )
    assert plain(findings.alike([0.2, 0.9, 0.8], "pearson")) == (
        "Times correlate with 0.80 (Pearson) in the median of 3 pairs of devices"
    )


@pytest.mark.parametrize(
    ("own", "others", "confirmed", "words"),
    [
        (4.0, [], True, "The first device with a confirmed figure"),
        (4.0, [], False, "No other device is confirmed yet"),
        (4.0, [2.0], True, "Rank 1 of 2 device models: it gains the most"),
        (4.0, [4.0], True, "Rank 1 of 2 device models: no other gains more"),
        (4.0, [5.0], True, "Rank 2 of 2 device models: no other gains less"),
        (4.0, [2.0, 3.0, 5.0], True, "Rank 2 of 4 device models: it gains more than 67 % of the others"),
        (4.0, [2.0, 5.0], False, "No rank yet: once confirmed it would have rank 2 of 3 device models"),
    ],
)
def test_the_place_of_a_device(own: float, others: list[float], confirmed: bool, words: str) -> None:
    rows = [speedup(own, "mine"), *(speedup(value, f"d{value}") for value in others)]
    ranking = crowd(*rows).ranking("mine")
    assert ranking is not None

    assert plain(findings.place(ranking, confirmed)) == words


def test_configurations_of_a_device() -> None:
    assert (
        plain(findings.configurations("best", 4.0, 5, 1))
        == "Of 5 configurations best is the fastest here: 4.00x"
    )
    assert plain(findings.configurations("fast", 5.0, 5, 3)) == (
        "Of 5 configurations fast is the fastest here: 5.00x; best has rank 3"
    )
    assert plain(findings.configurations("default", 1.0, 3, 2)) == (
        "Of 3 configurations none is faster than the default here"
    )
    assert findings.configurations("default", 1.0, 1, None) == (
        "No configuration besides the default has a figure that counts here"
    )


def test_releases() -> None:
    seen = datetime(2026, 11, 20, tzinfo=UTC)
    rows = [Release("r", str(value), value, None, None, 1, 1, seen, seen) for value in (6.0, 8.0, 6.0)]

    def words(*seen: Release) -> str:
        return plain(findings.releases(History("front", "best", "webgpu", "a GPU", seen)))

    assert findings.releases(None) == words() == "No driver is known"
    assert words(rows[0]) == "6.00x with WebGPU under the one driver and system seen so far"
    assert words(*rows[:2]) == "6.00-8.00x with WebGPU under 2 releases of driver and system"
    assert words(rows[0], rows[2]) == "6.00x with WebGPU under each of 2 releases of driver and system"


def answer(name: str, value: float | None, state: str = "valid") -> SessionSpeedup:
    return SessionSpeedup(
        configuration=name,
        baseline="default",
        speedup=value,
        low=None,
        high=None,
        clock="wall",
        pairs=2,
        drift=None,
        ate_max=0.02,
        state=state,
        reason="",
    )


@pytest.mark.parametrize(
    ("answers", "words"),
    [
        ([], "No run can be compared with one of the default"),
        ([answer("best", None)], "No run can be compared with one of the default"),
        ([answer("best", 9.0, "suspect")], "No speedup of this session counts"),
        ([answer("best", 3.0)], "In this session best is 3.00x faster than the default"),
        ([answer("best", 0.5)], "In this session best is 0.500x as fast as the default"),
        ([answer("best", 3.0), answer("fast", 4.0)], "Of 3 configurations fast is the fastest: 4.00x"),
        ([answer("b", 3.0), answer("a", 3.0)], "Of 3 configurations a is the fastest: 3.00x"),
        ([answer("b", 0.9), answer("a", 0.8)], "None of 2 configurations is faster than the default"),
    ],
)
def test_a_session(answers: list[SessionSpeedup], words: str) -> None:
    assert plain(findings.session(answers)) == words


def test_stages() -> None:
    default = StageTimes("default", 2, {"tracking": 0.03, "raycasting": 0.05, "integration": 0.02}, 0.1)
    best = StageTimes("best", 2, {"tracking": 0.006, "raycasting": 0.004}, 0.01)

    assert findings.stages([]) == "No times of single stages"
    assert plain(findings.stages([default])) == "Raycasting takes 50 % of the time of default"
    assert (
        plain(findings.stages([best, default]))
        == "Raycasting takes 50 % of the time of default and 40 % of best"
    )
    assert plain(findings.stages([best])) == "Tracking takes 60 % of the time of best"


def test_one_run() -> None:
    assert findings.run([]) == "No times of single stages"
    spread = [
        StageSpread("tracking", 0.01, 0.01, 0.01, 0.4),
        StageSpread("raycasting", 0.01, 0.01, 0.01, 0.5),
    ]
    assert plain(findings.run(spread)) == "Raycasting takes 50 % of the time"


@pytest.mark.parametrize(
    ("ratios", "words"),
    [
        ([], "No configuration ran twice"),
        ([1.0], "No configuration ran twice"),
        ([1.0, 1.0], "No run took longer than the first of its configuration"),
        ([1.0, 0.9], "No run took longer than the first of its configuration"),
        ([1.0, 1.021, 0.9], "No run took more than 2.1 % longer than the first of its configuration"),
        ([1.0, 1.05, 1.2], "Run 3, of best, took 20 % longer than its first"),
    ],
)
def test_drift(ratios: list[float], words: str) -> None:
    steps = [Step(number + 1, "best", number, ratio) for number, ratio in enumerate(ratios)]

    assert plain(findings.drift(steps)) == words


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ((2399.0, 2401.0, 2400.0), "Processor clock steady at 2,400 MHz"),
        ((2400.0, 1800.0), "Processor clock fell from 2,400 to 1,800 MHz"),
        ((1000.0, 2000.0, 1000.0), "Processor clock varied from 1,000 to 2,000 MHz"),
        ((0.0, 0.0), "Processor clock steady at 0 MHz"),
    ],
)
def test_sensors(values: tuple[float, ...], words: str) -> None:
    times: Any = tuple(float(number) for number in range(len(values)))

    assert plain(findings.sensors([Readings("processor clock", "MHz", times, values)])) == words


def test_several_sensors_and_none() -> None:
    rows = [
        Readings("temperature", "°C", (0.0, 2.0), (31.0, 45.5)),
        Readings("battery", "%", (0.0, 2.0), (80.0, 80.0)),
    ]

    assert plain(findings.sensors(rows)) == "Temperature rose from 31.0 to 45.5 °C; battery steady at 80.0 %"
    assert findings.sensors([]) == "No sensor was reported"
