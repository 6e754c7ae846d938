import pytest

from crowd.dashboard.content.race import MOST_BLOCKS, WIDTH, race


def test_both_lanes_take_the_same_time() -> None:
    lanes = race(6.2)

    assert lanes is not None
    default, best = lanes
    assert (default.frames, best.frames) == (4, pytest.approx(24.8))
    assert len(best.blocks) == 25
    for lane in lanes:
        last = lane.blocks[-1]
        assert WIDTH - 5 <= last.x + last.width <= WIDTH


def test_a_slower_best_is_shown_as_it_is() -> None:
    lanes = race(0.5)

    assert lanes is not None
    assert lanes[1].frames == 2


@pytest.mark.parametrize("speedup", [1.0, 9.7, 35.0, 59.0])
def test_blocks_stay_apart_on_a_phone(speedup: float) -> None:
    lanes = race(speedup)

    assert lanes is not None
    assert max(len(lane.blocks) for lane in lanes) <= MOST_BLOCKS


@pytest.mark.parametrize("speedup", [None, 0.0, -1.0, float("nan")])
def test_without_a_speedup_there_is_no_race(speedup: float | None) -> None:
    assert race(speedup) is None
