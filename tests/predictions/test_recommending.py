"""What to use on a device, and how good such advice turned out to be."""

from copy import deepcopy
from typing import Any

import pytest

from crowd.fronts.content.generalisation import Results, generalises
from crowd.predictions import maps, recommendations
from crowd.predictions.expectations import FrontPrediction, PredictedPoint
from crowd.predictions.models import Recommendation
from crowd.predictions.recommendations import LimitsNotMetError, recommend
from tests.builders.known_front import NAME
from tests.builders.measured import BEST_IS_BEST
from tests.builders.rows import front_of
from wire.front import Point, SequenceResult

# Integration alone is dear on this device, and probes that integrate less often were measured: points like
# them are predicted to win.
DIFFERENT: dict[str, Any] = {"costs": {"integration": 40.0}, "probes": ["probe-13", "probe-04", "probe-06"]}


def point(name: str, ratio: float, ate_max: float | None = 0.02, probe: bool = False) -> PredictedPoint:
    """A prediction whose interval reaches a tenth to either side."""
    return between(name, ratio, 0.9 * ratio, 1.1 * ratio, ate_max=ate_max, probe=probe)


def between(name: str, ratio: float, low: float, high: float, **changes: Any) -> PredictedPoint:
    usual: dict[str, Any] = {"parameters": {}, "ate_max": 0.02, "measured": False, "probe": False}
    return PredictedPoint(configuration=name, ratio=ratio, low=low, high=high, **(usual | changes))


def expectation(*points: PredictedPoint, seconds: float | None = None) -> FrontPrediction:
    return FrontPrediction((point("default", 1.0, 0.01), *points), (), seconds, "stages", 3, 5)


@pytest.mark.parametrize(
    ("points", "chosen"),
    [
        ([point("best", 10.0), point("front-01", 10.5)], "best"),  # within the interval
        ([point("best", 10.0), point("front-01", 12.0)], "front-01"),  # beyond it
        ([point("best", 10.0), point("front-01", 12.0, 0.06)], "best"),  # not exact enough
        ([point("best", 10.0), point("probe-01", 20.0, probe=True)], "best"),  # never checked elsewhere
        ([point("best", 10.0), point("front-01", 12.0, None)], "best"),  # its error is unknown
        ([point("best", 10.0, 0.06), point("front-01", 8.0), point("front-02", 7.0)], "front-01"),
    ],
)
def test_best_is_kept_unless_another_wins_by_more_than_its_interval(
    points: list[PredictedPoint], chosen: str
) -> None:
    assert recommend(expectation(*points)).configuration == chosen


def test_an_error_is_the_largest_of_the_sequences_learned_on(document: dict[str, Any]) -> None:
    """That of held-out sequences is known beside it."""
    known = deepcopy(document)
    (described,) = [one for one in known["configurations"] if one["name"] == "front-01"]
    described["predicted"]["ate_max"], described["learned_on"][0]["ate_max"] = 0.0199, 0.0213
    described["held_out"][0]["ate_max"] = 0.0227

    def read() -> Point | None:
        return front_of(known).point("front-01")

    for predicted, error in ((0.0199, 0.0213), (0.0215, 0.0215), (None, None)):
        described["predicted"]["ate_max"] = predicted
        one = read()
        assert one
        assert (one.ate_max, one.held_out_ate_max) == (error, 0.0227)


def test_a_point_that_does_not_generalise_is_never_recommended() -> None:
    """However fast it is. Its error on the sequences learned on says nothing."""
    special = between("front-01", 20.0, 18.0, 22.0, generalises=False)

    assert recommend(expectation(point("best", 10.0), special)).configuration == "best"
    own, default = (SequenceResult("attic", error, 0) for error in (0.08, 0.04))
    assert generalises(Results((), (default,)), Results((), (default,)))
    assert not generalises(Results((), (own,)), Results((), (default,)))
    assert not generalises(Results((), ()), Results((), (default,)))


def test_where_a_time_is_enough_the_most_accurate_is_chosen() -> None:
    expected = expectation(point("best", 10.0, 0.03), point("accurate", 4.0, 0.012), seconds=0.1)

    assert recommend(expected, 0.05, 0.03).configuration == "accurate"
    assert recommend(expected, 0.05, 0.02).configuration == "best"
    with pytest.raises(LimitsNotMetError, match="the fastest within the error takes 10 ms"):
        recommend(expected, 0.05, 0.005)


def test_what_cannot_be_kept_is_named() -> None:
    with pytest.raises(LimitsNotMetError, match=r"the least is 0.0100 m, by default"):
        recommend(expectation(point("best", 10.0)), 0.001)
    with pytest.raises(LimitsNotMetError, match="leave out max_ms"):
        recommend(expectation(point("best", 10.0)), 0.05, 0.03)


@pytest.mark.slow
def test_a_recommendation_is_noted_once_and_judged_when_it_was_measured(measured: Any) -> None:
    device = measured(**DIFFERENT)
    maps.rebuild()
    maps.rebuild()

    [advice] = Recommendation.objects.all()
    name = advice.configuration.name
    assert name not in ("default", "best")
    assert recommendations.judged_recommendations(NAME) == []

    device.submit_probes([name])
    [judged] = recommendations.judged_recommendations(NAME)

    assert judged.recommendation == advice
    assert judged.regret == 1.0
    assert judged.best_regret == pytest.approx(device.seconds("best") / device.seconds(name), rel=0.05)
    assert judged.best_regret > 1.2
    assert judged.within_interval


def test_where_best_is_best_nothing_is_noted(measured: Any) -> None:
    measured(costs=BEST_IS_BEST)

    maps.rebuild()

    assert not Recommendation.objects.exists()


@pytest.mark.slow
def test_recommendations_of_erased_devices_are_forgotten(measured: Any) -> None:
    device = measured(**DIFFERENT)
    maps.rebuild()
    assert Recommendation.objects.exists()

    device.participant.delete("/me")
    maps.rebuild()

    assert not Recommendation.objects.exists()


def test_a_sure_winner_counts_though_an_unsure_one_is_predicted_faster() -> None:
    unsure = between("front-01", 12.0, 9.0, 16.0)
    sure = between("front-02", 11.5, 11.3, 11.7)

    assert recommend(expectation(point("best", 10.0), unsure, sure)).configuration == "front-02"


def test_a_front_without_errors_recommends_nothing() -> None:
    expected = FrontPrediction(
        (point("default", 1.0, None), point("best", 10.0, None)), (), None, "stages", 1, 1
    )

    with pytest.raises(LimitsNotMetError, match="has a known error"):
        recommend(expected)


@pytest.mark.slow
def test_erasing_one_of_two_installations_takes_what_rested_on_it(measured: Any) -> None:
    goes, _stays = measured(**DIFFERENT), measured(**DIFFERENT)
    maps.rebuild()
    assert Recommendation.objects.count() == 1
    made_at = Recommendation.objects.get().made_at

    goes.participant.delete("/me")
    assert not Recommendation.objects.exists()
    maps.rebuild()

    assert Recommendation.objects.get().made_at > made_at
