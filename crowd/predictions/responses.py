"""Shapes of the answers about recommendations."""

from typing import Any

import msgspec

from crowd.predictions import recommending
from crowd.predictions.devices import Expectation, Expected
from crowd.predictions.selectors import Answer


class Ratio(msgspec.Struct):
    """How many times faster than the default, with its 95 % interval."""

    ratio: float
    low: float
    high: float


class Basis(msgspec.Struct):
    """What a prediction rests on: the model (`rung`; `reference`: no crowd, the reference device alone), how
    many sessions and devices taught it, and the devices most like this one.
    """

    rung: str
    sessions: int
    devices: int
    nearest: list[str]


class Point(msgspec.Struct):
    """A configuration on this device: its error (m; null where unknown) and ratio to the default."""

    configuration: str
    parameters: dict[str, Any]
    ate_max: float | None
    ratio: float
    low: float
    high: float
    state: str


class Recommendation(msgspec.Struct):
    """What to use on a device. `state`: predicted, or measured by that device itself.

    `default_seconds`: what a frame of the default takes there; null where nobody measured it. `front`: every
    point of the front on this device.
    """

    application: str
    front_version: str
    about: str
    configuration: str
    parameters: dict[str, Any]
    predicted: Ratio
    ate_max: float | None
    default_seconds: float | None
    basis: Basis
    state: str
    front: list[Point]


def recommendation(answer: Answer, max_ate: float, max_seconds: float | None) -> Recommendation:
    """ANSWER with the configuration that keeps the limits. Raises recommending.NothingKeepsLimitsError."""
    expected = answer.expectation
    chosen = recommending.choose(expected, max_ate, max_seconds)
    return Recommendation(
        application=answer.front.application,
        front_version=answer.front.slug,
        about=answer.about,
        configuration=chosen.configuration,
        parameters=chosen.parameters,
        predicted=Ratio(chosen.ratio, chosen.low, chosen.high),
        ate_max=chosen.ate_max,
        default_seconds=expected.seconds,
        basis=_basis(answer, expected),
        state=_state(chosen),
        front=[_point(point) for point in expected.points if not point.probe],
    )


def _basis(answer: Answer, expected: Expectation) -> Basis:
    nearest = [relative.device.slug for relative in answer.relatives]
    return Basis(expected.rung, expected.sessions, expected.devices, nearest)


def _point(point: Expected) -> Point:
    return Point(
        point.configuration,
        point.parameters,
        point.ate_max,
        point.ratio,
        point.low,
        point.high,
        _state(point),
    )


def _state(point: Expected) -> str:
    return "measured" if point.measured else "predicted"
