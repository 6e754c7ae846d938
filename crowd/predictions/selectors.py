"""Predictions for a device: one that measured, one that did not, or any device."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from django.db.models import Count

from crowd.devices.disclosure import find
from crowd.devices.models import Installation
from crowd.devices.naming import chips
from crowd.fronts import selectors as fronts
from crowd.predictions import maps, measurements, tables
from crowd.predictions.expectations import FrontPrediction, device_belief, predict, predict_similar
from crowd.predictions.measurements import Group, Row
from crowd.predictions.models import DeviceMap
from crowd.predictions.tables import CrowdTable
from crowd.records.device import Device
from crowd.results.models import DeviceSpeedup, MeasurementSession, State
from crowd.results.public_rows import read_devices
from pareto.devices.prediction import Belief
from wire.front import Front

# Devices that match a description: how many are read, and how many with valid figures are combined.
MAX_READ, MOST_POOLED = 200, 20
DEVICE_DEVIATION = 0.1  # prior standard deviation (logarithms) between two devices with one chip
# If a description matches several backends, that with the most devices is used, then this order.
PREFERRED_BACKENDS = ("opencl", "webgpu", "wasm")


class UnknownDeviceError(LookupError):
    """No measured device matches. The message says what else to ask for."""


class NothingConfirmedError(UnknownDeviceError):
    """Devices match, but no figure is confirmed. The message says how many wait.

    `reference`: what the reference device predicts.
    """

    def __init__(self, message: str, reference: "PredictionResult") -> None:
        super().__init__(message)
        self.reference = reference


class NoFrontError(LookupError):
    """No front of that application is published here."""


@dataclass(frozen=True)
class DeviceQuery:
    """A device by parts of its names; without any, any device. `backend` restricts to one backend."""

    model: str = ""
    gpu: str = ""
    soc: str = ""
    backend: str = ""

    @property
    def anything(self) -> bool:
        return not (self.model or self.gpu or self.soc)


@dataclass(frozen=True)
class Relative:
    """A similar device that a prediction uses, and why."""

    device: Device
    why: str


@dataclass(frozen=True)
class PredictionResult:
    """The prediction for the requested device.

    `device`: None for an unmeasured device. `about`: a description of the device.
    """

    front: Front
    group: Group
    device: Device | None
    about: str
    expectation: FrontPrediction
    relatives: tuple[Relative, ...]


def predict_for_device(
    slug: str, front_slug: str, backend: str, processor: str, processor_class: str
) -> PredictionResult | None:
    """The prediction for the device `slug` with one backend and chip; None for an unknown device or front.

    Without a confirmed figure, it is the prediction for its chip. Raises NothingConfirmedError.
    """
    model, front = find(slug), fronts.front(front_slug)
    if model is None or front is None or not tables.is_predictable(front):
        return None
    group = Group(fronts.key_of(front_slug), backend, processor_class)
    return _predict_for_row(front, group, Row(model.pk, processor)) or _predict_for_chip(
        front, group, processor, _unconfirmed(front, DeviceQuery(backend=backend))
    )


def predict_for_installation(installation: Installation, application: str | None) -> PredictionResult | None:
    """The prediction for the device of `installation`'s newest session; None without a session.

    It rests on what `installation` measured, and on confirmed figures. Without a valid session, it is the
    prediction for its chip. Raises NoFrontError, NothingConfirmedError.
    """
    front = _front(application)
    session = MeasurementSession.objects.filter(installation=installation, front__slug=front.slug).first()
    if session is None:
        return None
    group = Group(session.front_id, session.backend, session.processor_class)
    row = Row(session.device_id, session.processor)
    return _predict_for_row(front, group, row, installation) or _predict_for_chip(
        front, group, row.processor, _unconfirmed(front, DeviceQuery())
    )


def predict_for_query(question: DeviceQuery, application: str | None) -> PredictionResult:
    """The prediction for a device that matches `question`, from confirmed figures.

    Raises NoFrontError, UnknownDeviceError.
    """
    front = _front(application)
    rows = _matching_rows(front, question)
    matches = _largest([row for row in rows if row.confirmed])
    if matches and not question.anything:
        return _predict_for_matches(front, question, matches)
    if question.model or (question.soc and not question.gpu):
        called = f"{question.model or question.soc!r:.60}"
        instead = "ask for its graphics chip (gpu), or for no device"
        if rows:
            raise NothingConfirmedError(
                f"no figure of a device called {called} is confirmed yet{_waiting(len(rows))}: {instead}",
                reference_prediction(front, rows[0].group),
            )
        raise UnknownDeviceError(f"no measured device is called {called}: {instead}")
    chip = _chip(question.gpu)
    if question.gpu and not chip:
        raise UnknownDeviceError(
            f"no known chip is called {question.gpu!r:.60}: give its name, such as Adreno 650"
        )
    return _predict_for_chip(front, _largest_group(front, question), chip, len(rows))


def reference_prediction(front: Front, group: Group) -> PredictionResult:
    """What the reference device of `front` predicts for any device, without any crowd."""
    about = "any device, predicted from the reference device alone"
    empty = tables.read_table(front, group, [])
    expectation = predict(front, empty, maps.learned_map(None, front), None, "")
    return PredictionResult(front, group, None, about, expectation, ())


def _predict_for_chip(front: Front, group: Group, chip: str, unconfirmed: int) -> PredictionResult:
    """The prediction for a device with `chip` but without a confirmed figure; "": for any device.

    It is like the confirmed devices with `chip`, else a new one of its series. Raises NothingConfirmedError
    if no figure of `group` is confirmed; `unconfirmed` devices wait.
    """
    if not measurements.group_figures(group).exists():
        raise NothingConfirmedError(
            f"no figure of {front.slug} is confirmed yet{_waiting(unconfirmed)}",
            reference_prediction(front, group),
        )
    table = tables.read_table(front, group, tables.neighbours(group, chip) if chip else [])
    about = f"a device with {chip} (no confirmed figure)" if chip else "any device"
    if same := [name for name, processor in table.rows.processor.items() if processor == chip]:
        return _predict_like(front, group, table, same, about)
    learned = maps.learned_map(maps.find_map(group), front)
    expectation = predict(front, table, learned, None, tables.chip_series(chip))
    return PredictionResult(front, group, None, about, expectation, _relatives(table, expectation))


def _predict_for_row(
    front: Front, group: Group, row: Row, installation: Installation | None = None
) -> PredictionResult | None:
    """The prediction for the device of `row`; None without a figure of it that counts.

    What `installation` measured counts, too.
    """
    near = tables.neighbours(group, row.processor, row.device)
    table = tables.read_table(front, group, near, installation)
    if row.name not in table.rows.index:
        return None
    learned = maps.learned_map(maps.find_map(group), front)
    expectation = predict(front, table, learned, row.name, tables.chip_series(row.processor))
    shown = read_devices([row.device])[row.device]
    return PredictionResult(front, group, shown, shown.title, expectation, _relatives(table, expectation))


def _predict_for_matches(
    front: Front, question: DeviceQuery, matches: Sequence["_MatchingRow"]
) -> PredictionResult:
    """The prediction for the `matches` of one group: for their only device, or for a device like them."""
    group = matches[0].group
    rows = [one.row for one in matches[:MAX_READ]]
    if question.model and len({row.device for row in rows}) == 1:
        answers = (_predict_for_row(front, group, row) for row in rows)
        if answer := next((answer for answer in answers if answer), None):
            return answer
    table = tables.read_table(front, group, [row.device for row in rows])
    words = " ".join(part for part in (question.model, question.soc, question.gpu) if part)
    return _predict_like(front, group, table, [row.name for row in rows], f"a device like “{words}”")


def _predict_like(
    front: Front, group: Group, table: CrowdTable, rows: Sequence[str], about: str
) -> PredictionResult:
    """The prediction for a new device like those of `rows` of `table`."""
    names = _most_measured(table, rows)
    learned = maps.learned_map(maps.find_map(group), front)
    belief = _combine(
        [device_belief(table, learned, name, str(table.known.families[name])) for name in names]
    )
    expectation = predict_similar(front, table, learned, belief, names)
    return PredictionResult(front, group, None, about, expectation, _relatives(table, expectation))


def _most_measured(table: CrowdTable, names: Sequence[str]) -> list[str]:
    """At most MOST_POOLED of the rows `names` with at least half as many times as the row with the most.

    Otherwise a model of which little is known would widen what is known of the others.
    """
    counts = {name: len(table.seen[name]) for name in names if name in table.seen}
    most = max(counts.values(), default=0)
    return [name for name, count in counts.items() if 2 * count >= most][:MOST_POOLED]


def _combine(beliefs: Sequence[Belief]) -> Belief:
    """The belief about a new device like those of `beliefs`. It includes how much these differ."""
    means = np.array([belief.mean for belief in beliefs])
    count = len(beliefs)
    between = np.cov(means.T, ddof=1) * (1 + 1 / count) if count > 1 else 0.0
    covariance = np.mean([belief.covariance for belief in beliefs], axis=0) + between
    return Belief(means.mean(axis=0), covariance + np.eye(means.shape[1]) * DEVICE_DEVIATION**2)


def _front(application: str | None) -> Front:
    named = fronts.current_name(application)
    slug = named and named[0]
    front = fronts.front(slug) if slug else None
    if front is None:
        raise NoFrontError(f"no front of {application or 'anything'!r:.60} is published here")
    if not tables.is_predictable(front):
        raise NoFrontError(f"{front.slug} has no runtimes of its reference device")
    return front


@dataclass(frozen=True)
class _MatchingRow:
    """A device and chip with a valid figure. `confirmed`: one of its figures counts in public."""

    group: Group
    row: Row
    confirmed: bool


def _matching_rows(front: Front, question: DeviceQuery) -> list[_MatchingRow]:
    """The rows with a valid figure of `front` that match `question`. Two queries."""
    figures = DeviceSpeedup.objects.filter(front__slug=front.slug, state=State.VALID)
    if question.backend:
        figures = figures.filter(backend=question.backend)
    columns = ("front_id", "backend", "processor_class", "device_id", "processor")
    confirmed = Count("pk", filter=measurements.counted())
    rows = list(figures.order_by(*columns).values_list(*columns).annotate(confirmed=confirmed))
    devices = {} if question.anything else read_devices(device for *_, device, _, _ in rows)
    named = {key for key, device in devices.items() if device.slug == question.model}
    return [
        _MatchingRow(Group(key, backend, kind), Row(device, processor), count > 0)
        for key, backend, kind, device, processor, count in rows
        if question.anything
        or ((not named or device in named) and _matches(question, devices[device], processor))
    ]


def _largest(rows: Sequence[_MatchingRow]) -> list[_MatchingRow]:
    """Those of `rows` in the group with the most of them."""
    groups: dict[Group, list[_MatchingRow]] = {}
    for row in rows:
        groups.setdefault(row.group, []).append(row)
    return max(groups.values(), key=lambda rows: (len(rows), *_preference(rows[0].group)), default=[])


def _unconfirmed(front: Front, question: DeviceQuery) -> int:
    """How many devices with a valid figure of `front` match `question`, and none of their figures counts."""
    return sum(not row.confirmed for row in _matching_rows(front, question))


def _waiting(unconfirmed: int) -> str:
    """How many devices wait, if any, to continue a sentence."""
    if not unconfirmed:
        return ""
    devices = "device waits" if unconfirmed == 1 else "devices wait"
    return f", {unconfirmed} unconfirmed {devices} for more networks"


def _matches(question: DeviceQuery, device: Device, processor: str) -> bool:
    """Whether the public names of `device` contain all parts of `question`."""
    called = f"{device.title} {device.slug}".casefold()
    return (
        (question.model == device.slug or all(word in called for word in question.model.casefold().split()))
        and question.soc.casefold() in device.soc.casefold()
        and question.gpu.casefold() in f"{processor} {device.gpu}".casefold()
    )


def _chip(text: str) -> str:
    """The known name of the graphics chip `text`; "" if it is unknown."""
    chip = chips.graphics(text) if text else None
    return chip.name if chip else ""


def _largest_group(front: Front, question: DeviceQuery) -> Group:
    """The group of `front` with the most devices. Without any: that of OpenCL on graphics chips."""
    key = fronts.key_of(front.slug)
    groups = [
        one for one in measurements.groups() if one.front_id == key and question.backend in ("", one.backend)
    ]
    sizes = {one: device_map.devices if (device_map := maps.find_map(one)) else 0 for one in groups}
    if not sizes:
        return Group(key, question.backend or PREFERRED_BACKENDS[0], "gpu")
    return max(sizes, key=lambda one: (sizes[one], *_preference(one)))


def _preference(group: Group) -> tuple[bool, int]:
    rank = (
        PREFERRED_BACKENDS.index(group.backend)
        if group.backend in PREFERRED_BACKENDS
        else len(PREFERRED_BACKENDS)
    )
    return group.processor_class == "gpu", -rank


def _relatives(table: CrowdTable, expectation: FrontPrediction) -> tuple[Relative, ...]:
    why: dict[int, str] = {}
    for near in expectation.nearest:  # a device may have two chips
        why.setdefault(int(table.rows.device[near.row]), near.why)
    devices = read_devices(why)
    return tuple(Relative(devices[key], words) for key, words in why.items())


def maps_of(front: str) -> Sequence[DeviceMap]:
    """The maps of `front` (slug), those with the most devices first. One query."""
    rows = DeviceMap.objects.filter(front__slug=front)
    return list(rows.order_by("-devices", "backend").defer("belief"))
