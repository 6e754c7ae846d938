"""Times of a front's points relative to its default, and which of two is faster."""

import math

import pytest

from slam.references import times
from slam.references.times import Relative, Timed


def relative(*ratios: float, first: int = 0) -> Relative:
    """A point that took these times of the default's in consecutive rounds from `first` on."""
    return Relative(dict(enumerate(ratios, start=first)), [{}] * len(ratios))


def spread(ratio: float, by: float, rounds: int = 4) -> Relative:
    """A point around `ratio` whose rounds are off `by` (of a logarithm) in turn, upwards and downwards."""
    return relative(*(ratio * math.exp(by * (-1) ** number) for number in range(rounds)))


def test_each_point_is_timed_beside_the_default_that_ran_last() -> None:
    runs = [
        Timed(0, "default", 1.0, {"tracking": 0.25}),
        Timed(0, "best", 0.1, {"tracking": 0.05}),
        Timed(0, "default", 2.0, {"tracking": 0.5}),  # the machine became slower
        Timed(0, "knee", 0.4, {"tracking": 0.2}),
        Timed(1, "default", 1.0, {"tracking": 0.25}),
        Timed(1, "best", 0.1, {"tracking": 0.05}),
    ]

    ratios = times.relative(runs)

    assert ratios["best"].summary() == {
        "runtime_ratio": 0.1, "low": 0.1, "high": 0.1, "rounds": 2, "stages": {"tracking": 0.05},
    }  # fmt: skip
    assert ratios["knee"].summary()["runtime_ratio"] == 0.2
    assert ratios["default"].summary()["runtime_ratio"] == 1.0


def test_the_published_interval_is_students_of_the_logarithms() -> None:
    summary = spread(0.2, 0.1).summary()

    half = 3.182446 * math.sqrt(4 / 3 * 0.1**2) / 2
    assert summary["runtime_ratio"] == pytest.approx(0.2, rel=1e-5)
    assert summary["low"] == pytest.approx(0.2 * math.exp(-half), rel=1e-4)
    assert summary["high"] == pytest.approx(0.2 * math.exp(half), rel=1e-4)


def test_the_rounds_that_both_ran_in_decide_whether_points_are_faster_equal_or_open() -> None:
    fast, slow = spread(0.1, 0.001), spread(0.12, 0.001)
    assert (times.order(fast, slow), times.order(slow, fast)) == ("faster", "slower")
    assert times.order(fast, spread(0.101, 0.001)) == "equal"
    assert times.order(fast, spread(0.12, 0.3)) == "open"
    assert times.order(relative(0.1, 0.1), relative(0.2, 0.2, first=7)) == "open"  # never in one round
    # A slow round of the whole machine is in both.
    assert times.order(relative(0.1, 0.2, 0.1, 0.3), relative(0.12, 0.24, 0.12, 0.36)) == "faster"


def test_a_round_runs_the_default_before_every_eight_others() -> None:
    names = [f"point-{number}" for number in range(10)]

    assert times.with_default(["default", *names]) == ["default", *names[:8], "default", *names[8:]]
    assert times.with_default([]) == ["default"]


def test_after_the_first_rounds_only_undecided_points_run_and_at_most_twelve_rounds() -> None:
    points, probes = ["default", "best", "front-01", "knee"], ["probe-01"]
    ratios = {
        "default": spread(1.0, 0.0),
        "best": spread(0.1, 0.1),
        "front-01": spread(0.105, 0.0),
        "knee": spread(0.2, 0.001),
        "probe-01": spread(0.105, 0.1),
    }

    assert times.next_round(ratios, points, probes, 3) == ["default", "best", "front-01", "knee", "probe-01"]
    assert times.next_round(ratios, points, probes, 4) == ["default", "best", "front-01"]
    assert times.next_round(ratios, points, probes, 12) == []
    assert times.undecided(ratios, points) == {"best": ["front-01"], "front-01": ["best"]}
    assert times.next_round(ratios | {"best": spread(0.08, 0.001)}, points, probes, 4) == []


def test_of_equal_points_one_stays_and_kept_ones_are_never_beaten() -> None:
    ratios = {
        name: spread(ratio, 0.001) for name, ratio in {"a": 0.1, "b": 0.101, "c": 0.3, "d": 0.5}.items()
    }
    errors = {"a": 0.02, "b": 0.02, "c": 0.01, "d": 0.03}

    assert times.beaten(ratios, errors, []) == {"b": "a", "d": "c"}
    assert times.beaten(ratios, errors, ["d"]) == {"b": "a"}


def test_a_disturbed_run_does_not_count_and_its_round_stays_open() -> None:
    """20 ms of processor time a frame wait for 1 ms on idle cores, and 2 ms for 1 ms."""
    default, best = Timed(0, "default", 0.010, {}, 0.020, 0.001), Timed(0, "best", 0.001, {}, 0.002, 0.001)
    runs = [default, best, default._replace(round=1, waited=0.015), best._replace(round=1)]

    assert times.undisturbed(runs) == runs[:2]
    assert times.open_round(runs) == (1, {"default": 1, "best": 1})
    again = [*runs, default._replace(round=1), best._replace(round=1, waited=0.002)]
    assert times.open_round(again) == (1, {"best": 2})
    whole = [*again, default._replace(round=1), best._replace(round=1)]
    assert times.open_round(whole) is None
    found = times.relative(times.undisturbed(whole))["best"]
    assert found.summary().items() >= {"runtime_ratio": 0.1, "processor_ratio": 0.1, "rounds": 2}.items()


def test_where_nothing_is_known_of_processors_every_run_counts() -> None:
    runs = [Timed(0, "default", 0.010, {}), Timed(0, "best", 0.001, {})]

    assert times.open_round(runs) is None
    assert "processor_ratio" not in times.relative(runs)["best"].summary()
