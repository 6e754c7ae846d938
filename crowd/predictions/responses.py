"""Schemas of the responses about recommendations."""

from typing import Any

import msgspec

from crowd.predictions import recommendations
from crowd.predictions.expectations import FrontPrediction, PredictedPoint
from crowd.predictions.selectors import PredictionResult


class Ratio(msgspec.Struct):
    """How many times faster than the default, with its 95 % interval."""

    ratio: float
    low: float
    high: float


class Basis(msgspec.Struct):
    """The basis of a prediction: the model, its training data and the most similar devices.

    `rung`: the model; `reference`: only the reference device. `sessions`, `devices`: how many it learned
    from.
    """

    rung: str
    sessions: int
    devices: int
    nearest: list[str]


class Point(msgspec.Struct):
    """A configuration on this device: its error (m; null where unknown) and ratio to the default.

    `ate_max`: the largest on the sequences learned on, or on this device. `held_out_ate_max`: the largest on
    the held-out sequences; null without one.
    `skipped`: the share of the frames that it left out on the reference; absent if it computes all.
    """

    configuration: str
    parameters: dict[str, Any]
    ate_max: float | None
    held_out_ate_max: float | None
    ratio: float
    low: float
    high: float
    state: str
    skipped: float | msgspec.UnsetType = msgspec.UNSET


class SequenceNames(msgspec.Struct):
    """The sequences that a front was learned on, and those that it was only checked on."""

    learned_on: list[str]
    held_out: list[str]


class Recommendation(msgspec.Struct):
    """The configuration to use on a device. `state`: predicted, or measured on that device.

    `ate_max` (m), which the limit applies to: the largest error on the sequences learned on, or on this
    device. `held_out_ate_max`: the largest on the held-out `sequences`; null without one.
    `default_seconds`: time per frame of the default; null if it is unknown. `front`: all points of the front
    on this device.
    """

    application: str
    front_version: str
    about: str
    configuration: str
    parameters: dict[str, Any]
    predicted: Ratio
    ate_max: float | None
    held_out_ate_max: float | None
    sequences: SequenceNames
    default_seconds: float | None
    basis: Basis
    state: str
    front: list[Point]


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
        front=[_point(point) for point in expected.points if not point.probe],
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
