"""What to use on a device within limits: the answer of the predictions as pages show it."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from urllib.parse import urlencode

from django.db.models import Max

from crowd.devices import revision
from crowd.fronts import selectors as published
from crowd.predictions import maps, recommending, selectors
from crowd.predictions.devices import Expected
from crowd.predictions.models import DeviceMap
from crowd.predictions.selectors import Answer, NoFrontError, Question
from crowd.results.reading import selectors as results
from crowd.results.reading.queries.filters import InvalidFilterError, SpeedupFilters
from crowd.results.reading.rows import Speedup
from crowd.results.reading.versioned_cache import VersionedCache
from slam.protocol import VALID_BELOW

LONGEST = 100  # characters of a device's name
STEP = 0.0005  # m, of the slider
NAMES = ("model", "gpu", "soc")


@dataclass(frozen=True)
class Known:
    """An answer of the predictions, and when the map that predicts was made (None: there is no map).

    `crowd`: whether any device of the same kind has a figure of this front.
    """

    answer: Answer
    made_at: datetime | None
    crowd: bool


_cache: VersionedCache[Known | None] = VersionedCache(64)


@dataclass(frozen=True)
class Limits:
    """The largest error allowed (m), and a time a frame (s) that is fast enough; None for the fastest."""

    max_ate: float = VALID_BELOW
    max_seconds: float | None = None

    @classmethod
    def of(cls, query: Mapping[str, str]) -> "Limits":
        """What `max_ate` and `max_ms` of QUERY ask for. Raises InvalidFilterError."""
        milliseconds = _positive(query, "max_ms")
        return cls(
            _positive(query, "max_ate") or VALID_BELOW, None if milliseconds is None else milliseconds / 1e3
        )

    def parameters(self) -> dict[str, str]:
        """What asks for them, without what is so by default."""
        found = {} if self.max_ate == VALID_BELOW else {"max_ate": f"{self.max_ate:g}"}
        return found if self.max_seconds is None else found | {"max_ms": f"{self.max_seconds * 1e3:g}"}

    @property
    def options(self) -> str:
        """The same as options of the client's command line."""
        time = "" if self.max_seconds is None else f" --max-ms {self.max_seconds * 1e3:g}"
        return f"--max-ate {self.max_ate:g}{time}"


@dataclass(frozen=True)
class Advice:
    """What KNOWN recommends within LIMITS; `problem` says why that is nothing."""

    known: Known
    limits: Limits
    chosen: Expected | None
    problem: str

    @classmethod
    def of(cls, known: Known, limits: Limits) -> "Advice":
        try:
            chosen = recommending.choose(known.answer.expectation, limits.max_ate, limits.max_seconds)
        except recommending.NothingKeepsLimitsError as error:
            return cls(known, limits, None, str(error))
        return cls(known, limits, chosen, "")

    @property
    def answer(self) -> Answer:
        return self.known.answer

    @property
    def points(self) -> list[Expected]:
        """The points of the front on this device, without probes."""
        return [point for point in self.answer.expectation.points if not point.probe]

    @property
    def faster(self) -> Expected | None:
        """The fastest point within the error that may be faster than the chosen one. None where the chosen
        one is the fastest, and where a time was asked for.
        """
        if self.chosen is None or self.limits.max_seconds is not None:
            return None
        fastest = max(recommending.within(self.points, self.limits.max_ate), key=lambda point: point.ratio)
        return fastest if fastest.ratio > self.chosen.ratio else None

    @property
    def chosen_seconds(self) -> float | None:
        """What a frame of the recommended configuration takes; None where that is not known."""
        return None if self.chosen is None else self.seconds(self.chosen)

    def seconds(self, point: Expected) -> float | None:
        """What a frame of POINT takes here (s), None where the time of the default is unknown."""
        default = self.answer.expectation.seconds
        return None if default is None else default / point.ratio

    @property
    def rows(self) -> list[tuple[Expected, float | None]]:
        """The points of the front, each with its seconds a frame, as `seconds` answers."""
        return [(point, self.seconds(point)) for point in self.points]

    @property
    def slider(self) -> "Slider":
        return Slider.over(self.points, self.limits.max_ate)


@dataclass(frozen=True)
class Slider:
    """The limits (m) that can be chosen, as texts of a form."""

    least: str
    most: str
    value: str
    step: str = f"{STEP:g}"

    @classmethod
    def over(cls, points: list[Expected], max_ate: float) -> "Slider":
        """From the smallest error of POINTS, or one step, to the limit of valid runs; MAX_ATE is within."""
        errors = [point.ate_max for point in points if point.ate_max is not None]
        smallest = math.ceil(min(errors, default=STEP) / STEP) * STEP
        return cls(f"{min(smallest, max_ate):g}", f"{max(VALID_BELOW, max_ate):g}", f"{max_ate:g}")


@dataclass(frozen=True)
class Asked:
    """What a visitor asks for: a device (or any), an application ("": the usual one), and limits."""

    question: Question
    application: str
    limits: Limits

    @classmethod
    def of(cls, query: Mapping[str, str]) -> "Asked":
        """The device, application and limits of QUERY. Raises InvalidFilterError."""
        texts = {name: query.get(name, "").strip() for name in NAMES}
        for name, text in texts.items():
            if len(text) > LONGEST:
                raise InvalidFilterError(name, f"{name}: give at most {LONGEST} characters")
        question = Question(**texts, simulated=query.get("simulated") == "1")
        return cls(question, query.get("application", ""), Limits.of(query))

    @property
    def query(self) -> str:
        """The shortest query string that means the same."""
        return self.query_with(self.application)

    @property
    def of_any_device(self) -> "Asked":
        """The same limits for any device."""
        return replace(self, question=Question(simulated=self.question.simulated))

    def query_with(self, application: str) -> str:
        """The same for another APPLICATION."""
        texts = {name: getattr(self.question, name) for name in NAMES} | {"application": application}
        known = {name: text for name, text in texts.items() if text} | self.limits.parameters()
        return urlencode(known | ({"simulated": "1"} if self.question.simulated else {}))


def of_device(figure: Speedup | None) -> Known | None:
    """What to expect on the device, front, backend and chip of FIGURE; None where nothing is known of it."""
    if figure is None:
        return None
    key = (figure.device.slug, figure.front, figure.backend, figure.processor, figure.processor_class)
    return _kept(key, lambda: selectors.of_device(*key))


def ask(asked: Asked) -> Known:
    """What to expect on the device that is ASKED for. Raises NoFrontError, UnknownDeviceError."""
    application = asked.application or None
    if application not in {None, *(name for _, name in published.names())}:
        raise NoFrontError(f"no front of {application!r:.60} is published here")
    # A front that is published or retired changes no figure.
    fronts = (published.current_name(application), results.measured_front(asked.application, True))
    known = _kept((asked.question, application, fronts), lambda: selectors.ask(asked.question, application))
    assert known is not None  # ask answers or raises
    return known


def _kept(key: object, make: Callable[[], Answer | None]) -> Known | None:
    def known() -> Known | None:
        answer = make()
        if answer is None:
            return None
        found = maps.find(answer.group)
        return Known(answer, None if found is None else found.made_at, _has_crowd(answer))

    return _cache.get(_version, key, known)


def _has_crowd(answer: Answer) -> bool:
    if answer.device is not None:
        return True
    filters = SpeedupFilters(front=answer.front.slug, simulated=answer.group.simulated)
    return bool(results.speedups(filters).rows)


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
