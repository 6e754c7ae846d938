"""What is computed of runs and sessions, against figures that can be worked out by hand."""

from collections.abc import Iterable

import numpy as np
import pytest

from crowd.results.validity import measures


def mean_time(times: list[int]) -> float:
    return float(measures.mean_times(np.array([times]))[0])


def places(order: Iterable[str], name: str) -> dict[int, int]:
    """The places of the runs of `name` in `order`, by repeat."""
    return dict(enumerate(place for place, each in enumerate(order) if each == name))


def test_the_first_ten_frames_do_not_count() -> None:
    assert mean_time([10**6] * 10 + [3] * 90) == 3


def test_periodic_work_counts_in_full() -> None:
    """A median would say 1 of a configuration that works 100 every tenth frame."""
    assert mean_time(([1] * 9 + [100]) * 10) == pytest.approx(10.9)


def test_left_out_frames_that_take_longer_than_computed_ones() -> None:
    frames = np.array([[9, 1, 5, 1, 5], [9, 5, 1, 5, 1], [9, 5, 5, 5, 5], [9, 1, 9, 1, 1]])
    skipped = np.array([[0, 1, 0, 1, 0], [0, 1, 0, 1, 0], [0, 1, 1, 1, 1], [1, 0, 0, 0, 0]], dtype=bool)

    longer = measures.skipped_take_longer(frames, skipped, 1)

    # The third computed no counted frame, the fourth left out none.
    assert longer.tolist() == [False, True, False, False]


def test_a_run_without_counted_frames_has_no_mean() -> None:
    with pytest.raises(ValueError, match="from frame 10 on"):
        mean_time([1] * 10)


def test_stages_may_not_take_longer_than_the_frame() -> None:
    def exceed(**stages: int) -> bool:
        frames, series = np.full((1, 100), 1000), [[time] * 100 for time in stages.values()]
        found = measures.stages_exceed_frames(frames, list(stages), np.array(series).reshape(1, -1))
        return bool(found[0])

    assert not exceed(tracking=500, raycasting=500)
    assert not exceed(acquisition=9000, tracking=900)
    assert not exceed()
    assert exceed(tracking=800, raycasting=800)


ABBA = ["default", "best", "best", "default"]
ALL = ["default", "best", "knee", "fast", "fast", "knee", "best", "default"]
HONEST = {
    "as planned": (ABBA, 2),
    "two rounds": (ABBA * 2, 4),
    "interrupted before the last run": ([*ABBA, "default", "best", "best"], 2),
    "the whole front": (ALL, 2),
    "three repeats, forwards, back and forwards": (
        ["default", "best", "best", "default", "default", "best"],
        3,
    ),
    "one repeat": (["default", "best"], 1),
}


@pytest.mark.parametrize(("order", "planned"), HONEST.values(), ids=HONEST)
def test_what_the_client_runs_is_complete_and_balanced(order: list[str], planned: int) -> None:
    for name in set(order) - {"default"}:
        pair = places(order, "default"), places(order, name)
        assert measures.complete_pairs(*pair, planned)
        assert measures.balanced_order(*pair)


def test_half_a_session_or_one_with_a_gap_is_not_complete() -> None:
    every = places(ABBA * 2, "default"), places(ABBA * 2, "best")
    del every[1][1]

    assert not measures.complete_pairs({0: 0}, {0: 1}, 2)
    assert not measures.complete_pairs({0: 0, 1: 3}, {0: 1}, 2)
    assert not measures.complete_pairs(*every, 2)


def test_a_configuration_that_always_runs_later_is_not_balanced() -> None:
    one_after_another = ["default", "default", "best", "best"]
    in_turns = ["default", "best", "default", "best"]

    for order in (one_after_another, in_turns):
        assert not measures.balanced_order(places(order, "default"), places(order, "best"))
