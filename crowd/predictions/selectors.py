"""What to use on a device: on one that measured, on one that nobody measured, or on any."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crowd.devices import chips
from crowd.devices.disclosure import find
from crowd.devices.models import DeviceModel, Installation
from crowd.fronts import selectors as fronts
from crowd.fronts.selectors import Front
from crowd.predictions import maps, tables
from crowd.predictions.devices import Expectation, belief_of, expect, expect_of
from crowd.predictions.models import DeviceMap
from crowd.predictions.tables import CrowdTable, Group
from crowd.results.models import Cohort, MeasurementSession
from crowd.results.reading.public_rows import read_devices, simulated_only
from crowd.results.reading.rows import Device
from crowd.results.reading.speedups import measured_front
from pareto.devices.prediction import Belief

# Devices that answer to a description: so many are looked at, and so many with valid figures count.
MOST_READ, MOST_POOLED = 200, 20
DIFFERENT = 0.1  # standard deviation (logarithms) between two devices of one chip, before anything is known
# Where a description fits several kinds of measurements, the one with most devices answers, then this order.
PREFERRED = ("opencl", "webgpu")


class UnknownDeviceError(LookupError):
    """Nobody measured such a device; the message says what else could be asked."""


class NoFrontError(LookupError):
    """No front of that application is published here."""


@dataclass(frozen=True)
class Question:
    """Which device: parts of its names, or none for any device; `backend` where one kind is wanted."""

    model: str = ""
    gpu: str = ""
    soc: str = ""
    backend: str = ""
    simulated: bool = False

    @property
    def anything(self) -> bool:
        return not (self.model or self.gpu or self.soc)


@dataclass(frozen=True)
class Relative:
    """A device that a prediction rests on, and why."""

    device: Device
    why: str


@dataclass(frozen=True)
class Answer:
    """What is known or expected on the device asked for.

    `device` is None for one that nobody measured. `about` says in words what the answer is for.
    """

    front: Front
    group: Group
    device: Device | None
    about: str
    expectation: Expectation
    relatives: tuple[Relative, ...]


def of_device(
    slug: str, front_slug: str, backend: str, processor: str, processor_class: str
) -> Answer | None:
    """What to expect of the device SLUG with one backend and chip; None where it measured nothing of that."""
    model, front = find(slug), fronts.front(front_slug)
    if model is None or front is None or not tables.is_predictable(front):
        return None
    simulated = model.kind == DeviceModel.Kind.SIMULATED
    group = Group(fronts.key_of(front_slug), backend, processor_class, simulated)
    return _of_row(front, group, model.pk, processor)


def of_installation(installation: Installation, application: str | None) -> Answer | None:
    """What to expect of the device of INSTALLATION, by its newest session; None before the first. Without a
    valid figure it is what to expect of its chip.
    """
    front = _front(application, simulated=False)
    session = MeasurementSession.objects.filter(installation=installation, front__slug=front.slug).first()
    if session is None:
        return None
    simulated = session.device.kind == DeviceModel.Kind.SIMULATED
    group = Group(session.front_id, session.backend, session.processor_class, simulated)
    return _of_row(front, group, session.device_id, session.processor) or _of_chip(
        front, group, session.processor
    )


def ask(question: Question, application: str | None) -> Answer:
    """What to expect of a device that fits QUESTION. Raises NoFrontError, UnknownDeviceError."""
    front = _front(application, question.simulated)
    found = [] if question.anything else _fitting(front, question)
    if found and (answer := _pooled(front, question, found)):
        return answer
    if question.model or (question.soc and not question.gpu):
        raise UnknownDeviceError(
            f"nobody measured a device called {question.model or question.soc!r:.60}: ask for its graphics "
            "chip (gpu), or for no device"
        )
    chip = _chip(question.gpu)
    if question.gpu and not chip:
        raise UnknownDeviceError(
            f"no known chip is called {question.gpu!r:.60}: give its name, as Adreno 650"
        )
    group = _largest_group(front, question)
    return _of_chip(front, group, chip)


def _of_chip(front: Front, group: Group, chip: str) -> Answer:
    """What to expect of a device with CHIP that has no valid figure; "": of any device."""
    table = tables.read(front, group, tables.neighbourhood(group, chip) if chip else [])
    learned = maps.learned(maps.find(group), front)
    expectation = expect(front, table, learned, None, tables.family(chip))
    about = f"a device with {chip} that nobody measured" if chip else "any device"
    return Answer(front, group, None, about, expectation, _relatives(table, expectation))


def _of_row(front: Front, group: Group, device: int, processor: str) -> Answer | None:
    table = tables.read(front, group, tables.neighbourhood(group, processor, device))
    row = tables.row_name(device, processor)
    if row not in table.rows.index:
        return None
    learned = maps.learned(maps.find(group), front)
    expectation = expect(front, table, learned, row, tables.family(processor))
    shown = read_devices([device])[device]
    return Answer(front, group, shown, shown.title, expectation, _relatives(table, expectation))


def _pooled(front: Front, question: Question, found: Sequence[tuple[Group, int, str]]) -> Answer | None:
    """The answer of the rows FOUND, of one group: of their one device, or what they have in common.

    None where none of them has a valid figure.
    """
    group = found[0][0]
    rows = [(device, processor) for _, device, processor in found[:MOST_READ]]
    if question.model and len({device for device, _ in rows}) == 1:
        answers = (_of_row(front, group, *row) for row in rows)
        return next((answer for answer in answers if answer), None)
    table = tables.read(front, group, [device for device, _ in rows])
    names = [name for row in rows if (name := tables.row_name(*row)) in table.rows.index]
    names = names[:MOST_POOLED]
    if not names:
        return None
    learned = maps.learned(maps.find(group), front)
    belief = _pool([belief_of(table, learned, name, str(table.known.families[name])) for name in names])
    expectation = expect_of(front, table, learned, belief, names)
    words = " ".join(part for part in (question.model, question.soc, question.gpu) if part)
    return Answer(front, group, None, f"a device like “{words}”", expectation, _relatives(table, expectation))


def _pool(beliefs: Sequence[Belief]) -> Belief:
    """The belief about a further device like those that BELIEFS are about, as far as these differ."""
    means = np.array([belief.mean for belief in beliefs])
    count = len(beliefs)
    between = np.cov(means.T, ddof=1) * (1 + 1 / count) if count > 1 else 0.0
    covariance = np.mean([belief.covariance for belief in beliefs], axis=0) + between
    return Belief(means.mean(axis=0), covariance + np.eye(means.shape[1]) * DIFFERENT**2)


def _front(application: str | None, simulated: bool) -> Front:
    named = fronts.current_name(application)
    slug = named and named[0]
    if simulated and application is not None:
        slug = measured_front(application, simulated=True) or slug
    front = fronts.front(slug) if slug else None
    if front is None:
        raise NoFrontError(f"no front of {application or 'anything'!r:.60} is published here")
    if not tables.is_predictable(front):
        raise NoFrontError(f"{front.slug} does not say how fast its reference device was")
    return front


def _fitting(front: Front, question: Question) -> list[tuple[Group, int, str]]:
    """Group, device and processor of all rows that fit QUESTION, of the group with most of them."""
    rows = Cohort.objects.filter(simulated_only(question.simulated), front__slug=front.slug)
    if question.backend:
        rows = rows.filter(backend=question.backend)
    columns = ("front_id", "backend", "processor_class", "device_id", "processor")
    found = list(rows.order_by(*columns).values_list(*columns))
    devices = read_devices(device for *_, device, _ in found)
    named = {key for key, device in devices.items() if device.slug == question.model}
    found = [row for row in found if not named or row[3] in named]
    groups: dict[Group, list[tuple[Group, int, str]]] = {}
    for key, backend, kind, device, processor in found:
        if _fits(question, devices[device], processor):
            group = Group(key, backend, kind, question.simulated)
            groups.setdefault(group, []).append((group, device, processor))
    return max(groups.values(), key=lambda rows: (len(rows), *_preference(rows[0][0])), default=[])


def _fits(question: Question, device: Device, processor: str) -> bool:
    """Whether the public names of DEVICE have every part of QUESTION."""
    called = f"{device.title} {device.slug}".casefold()
    return (
        (question.model == device.slug or all(word in called for word in question.model.casefold().split()))
        and question.soc.casefold() in device.soc.casefold()
        and question.gpu.casefold() in f"{processor} {device.gpu}".casefold()
    )


def _chip(text: str) -> str:
    """The name by which the rules know the graphics chip TEXT; "" where they do not."""
    found = chips.graphics(text) if text else None
    return found.name if found else ""


def _largest_group(front: Front, question: Question) -> Group:
    """The group of FRONT with most devices; that of OpenCL on graphics chips where nothing was measured."""
    same = {one for one in tables.groups() if one.simulated == question.simulated}
    key = fronts.key_of(front.slug)
    own = [one for one in same if one.front == key and question.backend in ("", one.backend)]
    sizes = {one: found.devices if (found := maps.find(one)) else 0 for one in own}
    if not sizes:
        return Group(key, question.backend or PREFERRED[0], "gpu", question.simulated)
    return max(sizes, key=lambda one: (sizes[one], *_preference(one)))


def _preference(group: Group) -> tuple[bool, int]:
    place = PREFERRED.index(group.backend) if group.backend in PREFERRED else len(PREFERRED)
    return group.processor_class == "gpu", -place


def _relatives(table: CrowdTable, expectation: Expectation) -> tuple[Relative, ...]:
    why: dict[int, str] = {}
    for near in expectation.nearest:  # a device may have two chips
        why.setdefault(int(table.rows.device[near.row]), near.why)
    devices = read_devices(why)
    return tuple(Relative(devices[key], words) for key, words in why.items())


def maps_of(front: str, simulated: bool = False) -> Sequence[DeviceMap]:
    """The maps of FRONT (slug), those with most devices first. One query."""
    rows = DeviceMap.objects.filter(front__slug=front, simulated=simulated)
    return list(rows.order_by("-devices", "backend").defer("belief"))
