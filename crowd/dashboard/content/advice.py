"""Recommendations of configurations for a device within limits, as pages show them."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from urllib.parse import urlencode

from django.db.models import Max

from crowd.devices import revision
from crowd.fronts import selectors as published
from crowd.predictions import maps, recommendations, selectors
from crowd.predictions.expectations import PredictedPoint
from crowd.predictions.models import DeviceMap
from crowd.predictions.selectors import DeviceQuery, NoFrontError, NothingConfirmedError, PredictionResult
from crowd.records.speedup import Speedup
from crowd.results.reading.queries.filters import InvalidFilterError
from crowd.results.reading.versioned_cache import VersionedCache
from wire.front import DEFAULT, Front
from wire.protocol import VALID_BELOW

LONGEST = 100  # longest device name, in characters
STEP = 0.0005  # step of the slider, m
NAMES = ("model", "gpu", "soc")


@dataclass(frozen=True)
class DevicePrediction:
    """The prediction for a device. `made_at`: the date of the map behind it, None without one."""

    answer: PredictionResult
    made_at: datetime | None


_cache: VersionedCache[DevicePrediction | None] = VersionedCache(64)


@dataclass(frozen=True)
class Limits:
    """The largest allowed error (m), and a sufficient time per frame (s); None for the fastest."""

    max_ate: float = VALID_BELOW
    max_seconds: float | None = None

    @classmethod
    def of(cls, query: Mapping[str, str]) -> "Limits":
        """The limits `max_ate` and `max_ms` of `query`. Raises InvalidFilterError."""
        milliseconds = _positive(query, "max_ms")
        return cls(
            _positive(query, "max_ate") or VALID_BELOW, None if milliseconds is None else milliseconds / 1e3
        )

    def parameters(self) -> dict[str, str]:
        """The query parameters for these limits, without defaults."""
        parameters = {} if self.max_ate == VALID_BELOW else {"max_ate": f"{self.max_ate:g}"}
        return (
            parameters if self.max_seconds is None else parameters | {"max_ms": f"{self.max_seconds * 1e3:g}"}
        )

    @property
    def options(self) -> str:
        """The limits as command-line options of the client."""
        time = "" if self.max_seconds is None else f" --max-ms {self.max_seconds * 1e3:g}"
        return f"--max-ate {self.max_ate:g}{time}"


@dataclass(frozen=True)
class Advice:
    """The recommendation within `limits`; `problem` says why there is none."""

    prediction: DevicePrediction
    limits: Limits
    chosen: PredictedPoint | None
    problem: str

    @classmethod
    def of(cls, prediction: DevicePrediction, limits: Limits) -> "Advice":
        try:
            chosen = recommendations.recommend(
                prediction.answer.expectation, limits.max_ate, limits.max_seconds
            )
        except recommendations.LimitsNotMetError as error:
            return cls(prediction, limits, None, str(error))
        return cls(prediction, limits, chosen, "")

    @property
    def answer(self) -> PredictionResult:
        return self.prediction.answer

    @property
    def points(self) -> list[PredictedPoint]:
        """The points of the front on this device, without probes."""
        return [point for point in self.answer.expectation.points if not point.probe]

    @property
    def default(self) -> PredictedPoint | None:
        """The default on this device."""
        return next((point for point in self.points if point.configuration == DEFAULT), None)

    @property
    def faster(self) -> PredictedPoint | None:
        """The fastest point within the error that may be faster than the chosen one. None where the chosen
        one is the fastest, and where a time was asked for.
        """
        if self.chosen is None or self.limits.max_seconds is not None:
            return None
        fastest = max(recommendations.within(self.points, self.limits.max_ate), key=lambda point: point.ratio)
        return fastest if fastest.ratio > self.chosen.ratio else None

    @property
    def chosen_seconds(self) -> float | None:
        """Seconds per frame of the recommended configuration; None if unknown."""
        return None if self.chosen is None else self.seconds(self.chosen)

    def seconds(self, point: PredictedPoint) -> float | None:
        """Seconds per frame of `point` on this device; None if the time of the default is unknown."""
        default = self.answer.expectation.seconds
        return None if default is None else default / point.ratio

    @property
    def rows(self) -> list[tuple[PredictedPoint, float | None]]:
        """The points of the front, each with its seconds per frame."""
        return [(point, self.seconds(point)) for point in self.points]

    @property
    def slider(self) -> "Slider":
        return Slider.over(self.points, self.limits.max_ate)


@dataclass(frozen=True)
class Slider:
    """The range of limits (m) that a form offers, as texts."""

    least: str
    most: str
    value: str
    step: str = f"{STEP:g}"

    @classmethod
    def over(cls, points: list[PredictedPoint], max_ate: float) -> "Slider":
        """A slider from the smallest error of `points` to the limit of valid runs, including `max_ate`."""
        errors = [point.ate_max for point in points if point.ate_max is not None]
        smallest = math.ceil(min(errors, default=STEP) / STEP) * STEP
        return cls(f"{min(smallest, max_ate):g}", f"{max(VALID_BELOW, max_ate):g}", f"{max_ate:g}")


@dataclass(frozen=True)
class AdviceRequest:
    """A visitor's request: a device (or any), an application ("": the default), and limits."""

    question: DeviceQuery
    application: str
    limits: Limits

    @classmethod
    def of(cls, query: Mapping[str, str]) -> "AdviceRequest":
        """The device, application and limits of `query`. Raises InvalidFilterError."""
        texts = {name: query.get(name, "").strip() for name in NAMES}
        for name, text in texts.items():
            if len(text) > LONGEST:
                raise InvalidFilterError(name, f"{name}: give at most {LONGEST} characters")
        question = DeviceQuery(**texts)
        return cls(question, query.get("application", ""), Limits.of(query))

    @property
    def query(self) -> str:
        """The shortest query string for this request."""
        return self.query_with(self.application)

    @property
    def for_any_device(self) -> "AdviceRequest":
        """This request for any device."""
        return replace(self, question=DeviceQuery())

    def query_with(self, application: str) -> str:
        """The query string for this request with another `application`."""
        texts = {name: getattr(self.question, name) for name in NAMES} | {"application": application}
        return urlencode({name: text for name, text in texts.items() if text} | self.limits.parameters())


def for_device(figure: Speedup | None) -> DevicePrediction | None:
    """The prediction for the device, front, backend and chip of `figure`; None without one.

    Raises NothingConfirmedError.
    """
    if figure is None:
        return None
    key = (figure.device.slug, figure.front, figure.backend, figure.processor, figure.processor_class)
    return _cached(key, lambda: selectors.predict_for_device(*key))


def for_any_device(front: Front, limits: Limits) -> Advice | None:
    """The advice for any device within `limits`, where clients measure `front` now; None without runtimes.

    It is that of /recommend/ without a device. Without a confirmed figure, it is the reference device's.
    """
    try:
        return Advice.of(_for_question(DeviceQuery(), front.application, (front.slug, front.digest)), limits)
    except NothingConfirmedError as error:
        return Advice.of(DevicePrediction(error.reference, None), limits)
    except NoFrontError:
        return None


def for_request(request: AdviceRequest) -> DevicePrediction:
    """The prediction for the device that `request` names. Raises NoFrontError, UnknownDeviceError."""
    application = request.application or None
    if application and application not in {name for _, name in published.names()}:
        raise NoFrontError(f"no front of {application!r:.60} is published here")
    # The revision of figures does not change when a front is published or retired: it is part of the key.
    return _for_question(request.question, application, published.current_name(application))


def _for_question(
    question: DeviceQuery, application: str | None, front: tuple[str, str] | None
) -> DevicePrediction:
    prediction = _cached((question, front), lambda: selectors.predict_for_query(question, application))
    assert prediction is not None  # predict_for_query() returns an answer or raises
    return prediction


def _cached(key: object, make: Callable[[], PredictionResult | None]) -> DevicePrediction | None:
    def predict() -> DevicePrediction | None:
        answer = make()
        if answer is None:
            return None
        device_map = maps.find_map(answer.group)
        return DevicePrediction(answer, None if device_map is None else device_map.made_at)

    return _cache.get(_version, key, predict)


def _version() -> str:
    newest = DeviceMap.objects.aggregate(newest=Max("made_at"))["newest"]
    return f"{revision.current()} {newest}"


def _positive(query: Mapping[str, str], name: str) -> float | None:
    text = query.get(name, "").strip()
    if not text:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise InvalidFilterError(name, f"{name}={text:.20}: give a number above 0")
    return value
