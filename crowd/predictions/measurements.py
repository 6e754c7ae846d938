"""The measurements that predictions rest on: confirmed figures, and one voice of each network.

Anyone can send anything under any model's name. So public predictions use figures of known models that a
quorum of networks confirms. Stage times, errors and assigned probes need a quorum, too. An installation's own
sessions count for its own predictions alone.
"""

import math
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from django.conf import settings
from django.db.models import Avg, Exists, Max, Min, OuterRef, Q, QuerySet

from crowd.devices.models import Installation
from crowd.fronts.models import FrontVersion
from crowd.predictions.models import ProbeAssignment
from crowd.records.uncertainty import (
    EFFICIENCY,
    LEAST_DEVIATION,
    TYPICAL_DEVIATION,
    TYPICAL_UNITS,
    figure_estimate,
)
from crowd.results.figures import statistics
from crowd.results.figures.confirmation import confirmed
from crowd.results.intake import packing
from crowd.results.models import Cohort, DeviceSpeedup, Run, SessionSummary, State
from crowd.results.validity.measures import AGREEMENT
from pareto.devices.device_map import SEPARATOR, stage_quantity
from slam.system import STAGES
from wire.front import BEST, DEFAULT

SESSION_CONFIGURATIONS = (DEFAULT, BEST)  # what every session measures, including stages
STAGE_ERROR = 0.05  # standard error of the logarithm of a stage's ratio
# So many networks' stage times are read for a row: the earliest, so that newer ones never displace them.
MAX_NETWORKS = 5
# The standard deviation of normal values that are limited to Huber's 1.345 deviations, as part of their own.
LIMITED = 0.843


class Group(NamedTuple):
    """The devices that are in one table."""

    front_id: int
    backend: str
    processor_class: str


class Row(NamedTuple):
    """A device (key) with a chip."""

    device: int
    processor: str

    @property
    def name(self) -> str:
        return f"{self.device} {self.processor}"


class Figure(NamedTuple):
    """A device's figure of a configuration: log ratio, its standard error, and error (m), None if unknown."""

    log_ratio: float
    error: float
    ate_max: float | None


class StageSources(NamedTuple):
    """The sessions with the stage times of a row. `own`: of its device, not of others with its chip."""

    sessions: list[int]
    own: bool


@dataclass(frozen=True)
class Measurements:
    """What counts of a group's devices.

    `figures`: by row and configuration. `sessions`: by row. `stages`: columns row, quantity, ratio.
    `seconds`: per frame of the default, by row.
    """

    figures: Mapping[tuple[Row, str], Figure]
    sessions: Mapping[Row, int]
    stages: pd.DataFrame
    seconds: pd.Series


class _Voice(NamedTuple):
    """What one network measured of a configuration. `first` and `last`: keys of its sessions."""

    log_ratio: float
    ate_max: float | None
    first: int
    last: int

    @classmethod
    def of(cls, members: Sequence["_Voice"]) -> "_Voice":
        """The voice of a network with the installations `members`."""
        return cls(
            fmean(one.log_ratio for one in members),
            max((one.ate_max for one in members if one.ate_max is not None), default=None),
            min(one.first for one in members),
            max(one.last for one in members),
        )


def counted() -> Q:
    """Selects the figures that public predictions use: confirmed ones of known models.

    A rule, the catalogue or an administrator knows the name of a known model. With a quorum of one, models
    need not be known.
    """
    of_known_models = Q(device__named=True) if settings.FRONTRUNNER_QUORUM > 1 else Q()
    return confirmed() & of_known_models


def groups() -> list[Group]:
    """All groups of published fronts with figures that count. One query."""
    rows = DeviceSpeedup.objects.filter(
        counted(), state=State.VALID, front__state=FrontVersion.State.PUBLISHED
    ).order_by()
    return sorted(Group(*row) for row in rows.values_list(*Group._fields).distinct())


def group_figures(group: Group) -> QuerySet[DeviceSpeedup]:
    """The figures of `group` that count."""
    return DeviceSpeedup.objects.filter(counted(), state=State.VALID, **group._asdict()).order_by()


def assigned_to(installation: OuterRef, configuration: OuterRef) -> QuerySet[ProbeAssignment]:
    """The assignments of `configuration` to `installation`, references to columns of another query."""
    return ProbeAssignment.objects.filter(installation=installation, configuration=configuration)


def group_cohorts(group: Group) -> QuerySet[Cohort]:
    """The cohorts of `group`, whether their figures count or not."""
    return Cohort.objects.filter(**group._asdict())


def read(group: Group, first_frame: int, devices: Collection[int] | None = None) -> Measurements:
    """What counts of `group`; only of `devices` (keys), if given. Three queries.

    `first_frame`: the first counted frame of a run.
    """
    wanted = group_figures(group)
    if devices is not None:
        wanted = wanted.filter(device__in=devices)
    lines = list(
        wanted.values_list(
            *("device", "processor", "configuration__name", "configuration__probe", "speedup", "sessions"),
            *("deviation", "units", "session_low", "session_high"),
        ).iterator()
    )
    voices = _Voices.read(group, {processor for _, processor, *_ in lines})
    figures, sessions = dict[tuple[Row, str], Figure](), defaultdict[Row, int](int)
    for device, processor, name, probe, speedup, count, *uncertain in lines:
        row, log = Row(device, processor), math.log(speedup)
        sessions[row] = max(sessions[row], count)
        if not probe or settings.FRONTRUNNER_QUORUM == 1:
            error = voices.error(row, name) or figure_estimate(log, *uncertain).error
            figures[row, name] = Figure(log, error, voices.ate_max(row, name))
    for row in sessions if settings.FRONTRUNNER_QUORUM > 1 else ():
        for name in voices.probes:
            if figure := voices.figure(row, name):
                figures[row, name] = figure
    stages, seconds = _stages({row: voices.stage_sources(row) for row in sessions}, first_frame)
    return Measurements(figures, sessions, stages, seconds)


def read_own(group: Group, first_frame: int, installation: Installation) -> Measurements:
    """What `installation` measured in `group`, confirmed or not: for its own predictions alone.

    Two queries.
    """
    rows = SessionSummary.objects.filter(
        installation=installation, cohort__in=group_cohorts(group), counted=True, state=State.VALID
    ).order_by("session")
    columns = ("session", "log_ratio", "low", "high", "ate_max")
    measured = defaultdict[tuple[Row, str], list[tuple[Any, ...]]](list)
    for device, processor, name, *values in rows.values_list(
        "cohort__device", "cohort__processor", "configuration__name", *columns
    ):
        measured[Row(device, processor), name].append(tuple(values))
    figures, sources = {}, {}
    for (row, name), values in measured.items():
        keys, logs, lows, highs, errors = zip(*values, strict=True)
        ends = (lows[0], highs[0]) if len(values) == 1 else (None, None)
        low, high = (None if end is None else math.exp(end) for end in ends)
        log = fmean(logs)
        ate_max = max((error for error in errors if error is not None), default=None)
        figures[row, name] = Figure(log, figure_estimate(log, None, 1, low, high).error, ate_max)
        if name == BEST:
            sources[row] = StageSources([keys[-1]], own=True)
    sessions = {row: len(values) for (row, _), values in measured.items()}
    return Measurements(figures, sessions, *_stages(sources, first_frame))


@dataclass(frozen=True)
class _Voices:
    """What each network measured, by device and by chip. `probes`: the measured probes that were assigned.

    A network has one voice for each configuration of a device or chip.
    """

    quorum: int
    probes: frozenset[str]
    by_device: Mapping[tuple[Row, str], Mapping[str, _Voice]]
    by_chip: Mapping[tuple[str, str], Mapping[str, _Voice]]

    @classmethod
    def read(cls, group: Group, chips: Collection[str]) -> "_Voices":
        """The voices of `group` on `chips`: of known models, without unassigned probes. One query."""
        rows = SessionSummary.objects.filter(
            cohort__in=group_cohorts(group).filter(processor__in=chips), counted=True, state=State.VALID
        )
        if settings.FRONTRUNNER_QUORUM > 1:
            assigned = Exists(assigned_to(OuterRef("installation"), OuterRef("configuration")))
            rows = rows.filter(Q(configuration__probe=False) | assigned, cohort__device__named=True)
            rows = rows.exclude(installation__network="")
        members = defaultdict[tuple[Row, str, str], list[_Voice]](list)
        probes = set()
        for device, processor, name, probe, network, installation, *values in (
            rows.order_by()
            .values_list(
                *("cohort__device", "cohort__processor", "configuration__name", "configuration__probe"),
                *("installation__network", "installation"),
            )
            .annotate(Avg("log_ratio"), Max("ate_max"), Min("session"), Max("session"))
        ):
            members[Row(device, processor), name, network or str(installation)].append(_Voice(*values))
            if probe:
                probes.add(name)
        by_device = defaultdict[tuple[Row, str], dict[str, _Voice]](dict)
        by_chip = defaultdict[tuple[str, str], dict[str, _Voice]](dict)
        heard = [(_Voice.of(voices), *where) for where, voices in members.items()]
        for voice, row, name, key in sorted(heard, key=lambda one: one[0].first):
            by_device[row, name][key] = voice
            by_chip[row.processor, name].setdefault(key, voice)
        return cls(settings.FRONTRUNNER_QUORUM, frozenset(probes), by_device, by_chip)

    def heard(self, row: Row, name: str) -> tuple[Mapping[str, _Voice], bool]:
        """A quorum of voices on the device of `row`, the earliest first; else on its chip; else none.

        And whether they are of the device.
        """
        on_device, chip = self.by_device.get((row, name), {}), self.by_chip.get((row.processor, name), {})
        if len(on_device) >= self.quorum:
            return on_device, True
        return (chip if len(chip) >= self.quorum else {}), False

    def ate_max(self, row: Row, name: str) -> float | None:
        """The largest error (m) that a quorum of networks reached; None without a quorum."""
        voices, _ = self.heard(row, name)
        errors = sorted((one.ate_max for one in voices.values() if one.ate_max is not None), reverse=True)
        return errors[self.quorum - 1] if len(errors) >= self.quorum else None

    def figure(self, row: Row, name: str) -> Figure | None:
        """The figure in which a quorum of networks agrees, as device models' figures are computed."""
        voices, _ = self.heard(row, name)
        logs = [one.log_ratio for one in voices.values()]
        if not logs:
            return None
        log = float(statistics.robust_mean(logs))
        if statistics.agreement(list(voices), logs).witnesses(log) < self.quorum:
            return None
        return Figure(log, robust_error(logs), self.ate_max(row, name))

    def error(self, row: Row, name: str) -> float | None:
        """The standard error of the figure of `row`'s own networks; None without a quorum of several."""
        voices, is_own = self.heard(row, name)
        return (
            robust_error([one.log_ratio for one in voices.values()]) if is_own and self.quorum > 1 else None
        )

    def stage_sources(self, row: Row) -> StageSources:
        """The newest session of each of the earliest MAX_NETWORKS networks."""
        voices, is_own = self.heard(row, BEST)
        return StageSources([one.last for one in list(voices.values())[:MAX_NETWORKS]], is_own)


def robust_error(logs: Sequence[float]) -> float:
    """The standard error of the robust mean of `logs`, two or more. One distant value hardly changes it.

    Values beyond Huber's limit count as if they were at it, in the deviation, too. It is averaged with the
    typical one, as for figures of fewer units.
    """
    values = np.array(logs)
    reach = statistics.HUBER * float(
        np.clip(statistics.robust_deviation(values), LEAST_DEVIATION, AGREEMENT / statistics.HUBER)
    )
    centre = float(statistics.robust_mean(values))
    deviation = float(values.clip(centre - reach, centre + reach).std(ddof=1)) / LIMITED
    degrees = len(values) - 1
    squares = degrees * deviation**2 + TYPICAL_UNITS * TYPICAL_DEVIATION**2
    return math.sqrt(squares / (degrees + TYPICAL_UNITS) / (EFFICIENCY * len(values)))


def _stages(sources: Mapping[Row, StageSources], first_frame: int) -> tuple[pd.DataFrame, pd.Series]:
    """The stages and seconds of each row, medians over the sessions of `sources`. One query."""
    wanted = pd.DataFrame(
        [(row.name, session, one.own) for row, one in sources.items() for session in one.sessions],
        columns=["row", "session", "own"],
    )
    runs = Run.objects.filter(
        session__in=wanted.session.unique().tolist(),
        configuration__name__in=SESSION_CONFIGURATIONS,
        status=Run.Status.OK,
        state=State.VALID,
    )
    times: list[tuple[int, str, float]] = []
    columns = ("session", "configuration__name", "mean_us", "frames__content")
    for session, name, mean_us, content in runs.order_by().values_list(*columns).iterator():
        times.append((session, name, mean_us / 1e6))
        series = packing.decompress(content)
        for stage, each in packing.unpack_stages(series.stages, series.stages_us).items():
            if stage in STAGES:
                times.append((session, stage_quantity(name, stage), float(each[first_frame:].mean()) / 1e6))
    mean = pd.DataFrame(times, columns=["session", "quantity", "time"])
    mean = mean.groupby(["session", "quantity"], as_index=False).time.mean()
    default = mean[mean.quantity == DEFAULT].set_index("session").time
    stage_times = mean[(mean.time > 0) & mean.quantity.str.contains(SEPARATOR, regex=False)]
    stage_times = stage_times.assign(ratio=np.log(stage_times.session.map(default) / stage_times.time)).merge(
        wanted, on="session"
    )
    stages = stage_times.groupby(["row", "quantity"], as_index=False).ratio.median()
    own_sessions = wanted[wanted.own.astype(bool)]
    seconds = own_sessions.session.map(default).groupby(own_sessions.row).median()
    return stages, seconds
