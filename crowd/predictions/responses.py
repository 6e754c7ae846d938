"""The response about recommendations, from a prediction."""

import msgspec

from crowd.predictions import recommendations
from crowd.predictions.expectations import FrontPrediction, PredictedPoint
from crowd.predictions.selectors import PredictionResult
from wire.recommendation import Basis, Point, Ratio, Recommendation, SequenceNames


def recommendation(answer: PredictionResult, max_ate: float, max_seconds: float | None) -> Recommendation:
    """`answer` with the configuration that meets the limits. Raises recommendations.LimitsNotMetError."""
    expected = answer.expectation
    chosen = recommendations.recommend(expected, max_ate, max_seconds)
    return Recommendation(
        application=answer.front.application,
        front_version=answer.front.slug,
        about=answer.about,
        configuration=chosen.configuration,
        parameters=chosen.parameters,
        predicted=Ratio(chosen.ratio, chosen.low, chosen.high),
        ate_max=chosen.ate_max,
        held_out_ate_max=chosen.held_out_ate_max,
        sequences=SequenceNames(*answer.front.sequence_names),
        default_seconds=expected.seconds,
        basis=_basis(answer, expected),
        state=_state(chosen),
        front=tuple(_point(point) for point in expected.points if not point.probe),
    )


def _basis(answer: PredictionResult, expected: FrontPrediction) -> Basis:
    nearest = [relative.device.slug for relative in answer.relatives]
    return Basis(expected.rung, expected.sessions, expected.devices, nearest)


def _point(point: PredictedPoint) -> Point:
    return Point(
        point.configuration,
        point.parameters,
        point.ate_max,
        point.held_out_ate_max,
        point.ratio,
        point.low,
        point.high,
        _state(point),
        msgspec.UNSET if point.skipped is None else point.skipped,
    )


def _state(point: PredictedPoint) -> str:
    return "measured" if point.measured else "predicted"
