"""The response about recommendations, from a prediction."""

import msgspec

from crowd.predictions import recommendations
from crowd.predictions.expectations import FrontPrediction, PredictedPoint
from crowd.predictions.selectors import PredictionResult
from wire.recommendation import Basis, Point, Ratio, Recommendation, SequenceNames


def recommendation(prediction: PredictionResult, max_ate: float, max_seconds: float | None) -> Recommendation:
    """`prediction` with the configuration that meets the limits. Raises recommendations.LimitsNotMetError."""
    expected = prediction.expectation
    chosen = recommendations.recommend(expected, max_ate, max_seconds)
    return Recommendation(
        application=prediction.front.application,
        front_version=prediction.front.slug,
        about=prediction.about,
        configuration=chosen.configuration,
        parameters=chosen.parameters,
        predicted=Ratio(chosen.ratio, chosen.low, chosen.high),
        ate_max=chosen.ate_max,
        held_out_ate_max=chosen.held_out_ate_max,
        sequences=SequenceNames(*prediction.front.sequence_names),
        default_seconds=expected.seconds,
        basis=_basis(prediction, expected),
        state=chosen.state,
        front=tuple(_point(point) for point in expected.points if not point.probe),
    )


def _basis(prediction: PredictionResult, expected: FrontPrediction) -> Basis:
    nearest = [relative.device.slug for relative in prediction.relatives]
    return Basis(expected.rung, expected.sessions, expected.devices, nearest)


def _point(point: PredictedPoint) -> Point:
    values = {name: getattr(point, name) for name in Point.__struct_fields__}
    return Point(**values | {"skipped": msgspec.UNSET if point.skipped is None else point.skipped})
