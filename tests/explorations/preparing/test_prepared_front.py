"""Which points of a draft clients get after its preparation, and under which names."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest

from crowd.explorations.preparing import prepared_front
from crowd.explorations.preparing.prepared_front import Measured, NotPreparableError
from slam.references.times import Timed
from tests.builders.rows import front_of
from wire.front import Front

ROUNDS = 4
ORDER = ("default", "best", "best", "default")
ADAPTIVE_ORDER = ("default", "best", "adaptive", "adaptive", "best", "default")
PROTOCOL = {
    "version": 2,
    "warmup_frames": 0,
    "frames": 2,
    "first_counted_frame": 0,
    "repeats": 4,
    "rest_seconds": 0,
    "max_ate": 0.05,
}


def front(errors: dict[str, float], order: Sequence[str] = ORDER, **lost: int) -> Front:
    """A draft with these errors (m) on the room learned on; some points `lost` so many frames there."""

    def point(name: str, error: float) -> dict[str, Any]:
        result = {"sequence": "room", "ate_max": error, "lost": lost.get(name.replace("-", "_"), 0)}
        predicted = {"runtime": 0.1, "ate_max": error, "ate_mean": error / 2}
        return {"name": name, "parameters": {"n": name}, "predicted": predicted, "learned_on": [result]}

    return front_of(
        {
            "application": "toy",
            "version": "1",
            "protocol": PROTOCOL | {"order": order},
            "sequence": {"name": "room", "sha256": "0" * 64},
            "configurations": [point(name, error) for name, error in errors.items()],
            "provenance": {},
        }
    )


def measured(ratios: dict[str, float], noise: float = 0.001) -> Measured:
    """Runs in ROUNDS with times `ratios` over the default's, each off by `noise` upwards and downwards."""
    runs = [
        Timed(number, name, ratio * math.exp(noise * (-1) ** (number + place)), {"tracking": ratio / 2})
        for number in range(ROUNDS)
        for place, (name, ratio) in enumerate(ratios.items())
    ]
    references = {
        name: {"trajectory": [[0, 0, 0]] * 2, "band": 0.002, "largest_deviation": 0.0, "variants": ["a", "b"]}
        | {"program": None}
        for name in ratios
    }
    return Measured(references, runs, device={"name": "Bench", "driver": "1"}, software="0.1")


def referred(runs: Measured, **changes: dict[str, float]) -> Measured:
    """`runs` with other members in the references of some points."""
    references = {
        name: {**reference, **changes.get(name.replace("-", "_"), {})}
        for name, reference in runs.references.items()
    }
    return replace(runs, references=references)


def names_of(document: dict[str, Any]) -> dict[str, str]:
    return {point["name"]: point["parameters"]["n"] for point in document["configurations"]}


def test_a_best_that_another_point_beats_in_error_and_time_is_left_out_and_the_name_passes_on() -> None:
    draft = front({"default": 0.01, "best": 0.0209, "front-01": 0.0198, "knee": 0.011, "accurate": 0.008})
    runs = measured({"default": 1.0, "best": 0.1023, "front-01": 0.0849, "knee": 0.2, "accurate": 0.5})

    document = prepared_front.document(draft, runs)

    assert names_of(document) == {
        "default": "default",
        "best": "front-01",
        "accurate": "accurate",
        "knee": "knee",
    }
    prepared = document["provenance"]["prepared"]
    assert prepared["left_out"] == {
        "best": "best (front-01 in the draft) is at least as fast and as accurate"
    }
    assert prepared["renamed"] == {"front-01": "best"}


def test_points_that_are_equally_fast_and_accurate_are_one_and_labelled_ones_stay() -> None:
    draft = front({"default": 0.01, "best": 0.02, "front-01": 0.02, "fast1": 0.04})
    runs = measured({"default": 1.0, "best": 0.1, "front-01": 0.101, "fast1": 0.5})

    assert list(names_of(prepared_front.document(draft, runs))) == ["default", "best", "fast1"]


def test_points_that_are_not_told_apart_are_marked_on_both_sides() -> None:
    draft = front({"default": 0.01, "best": 0.03, "front-01": 0.02})
    runs = measured({"default": 1.0, "best": 0.1, "front-01": 0.105}, noise=0.1)

    document = prepared_front.document(draft, runs)

    marked = {point["name"]: point["not_told_apart"] for point in document["configurations"]}
    assert marked == {"default": [], "best": ["accurate"], "accurate": ["best"]}


def test_best_is_the_fastest_that_holds_on_every_sequence() -> None:
    draft = front({"default": 0.01, "best": 0.02, "front-01": 0.015}, best=9)
    runs = measured({"default": 1.0, "best": 0.05, "front-01": 0.1})

    assert names_of(prepared_front.document(draft, runs))["best"] == "front-01"


def test_a_draft_without_any_point_that_is_surely_faster_has_no_best() -> None:
    draft = front({"default": 0.01, "best": 0.009})

    with pytest.raises(NotPreparableError, match="no point is best: none is surely faster than the default"):
        prepared_front.document(draft, measured({"default": 1.0, "best": 0.99}, noise=0.05))


def test_the_fastest_that_leaves_out_frames_is_adaptive_and_best_computes_every_frame() -> None:
    draft = front({"default": 0.01, "best": 0.03, "front-01": 0.031, "front-02": 0.02})
    runs = measured({"default": 1.0, "best": 0.05, "front-01": 0.06, "front-02": 0.1})
    runs = referred(runs, best={"skipped": 0.7}, front_01={"skipped": 0.6})

    document = prepared_front.document(draft, runs)

    assert names_of(document) == {"default": "default", "adaptive": "best", "best": "front-02"}
    assert [point.get("skipped") for point in document["configurations"]] == [None, None, 0.7]
    assert document["protocol"]["order"] == ADAPTIVE_ORDER


def test_a_point_whose_band_is_too_wide_is_left_out_of_the_sessions_too() -> None:
    draft = front({"default": 0.01, "best": 0.02, "adaptive": 0.03}, ADAPTIVE_ORDER)
    runs = measured({"default": 1.0, "best": 0.1, "adaptive": 0.05})
    runs = referred(runs, adaptive={"skipped": 0.7, "band": 0.021})

    document = prepared_front.document(draft, runs)

    assert "adaptive" in document["provenance"]["prepared"]["left_out"]
    assert document["protocol"]["order"] == ORDER
