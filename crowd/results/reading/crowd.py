"""The crowd under filters: its bars, its figure in one line and in parts, and where a device stands in it.

Pure functions of rows.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from django.conf import settings

from crowd.fronts.selectors import BEST
from crowd.results.figures import statistics
from crowd.results.reading.backends import preference
from crowd.results.reading.queries.filters import ALL, SpeedupFilters
from crowd.results.reading.rows import Attempt, Attempts, Headline, Place, Share, Speedup

PARTS = ("vendor", "backend", "soc", "os")


@dataclass(frozen=True)
class Speedups:
    """What the filters leave, fastest first, and the front they mean (None: no front is published)."""

    filters: SpeedupFilters
    front: str | None
    rows: tuple[Speedup, ...]
    attempts: tuple[Attempt, ...]  # of every configuration, whatever came of it

    @cached_property
    def headline(self) -> Headline:
        """The figure of the configuration that the filters name."""
        return headline(self.rows, self.filters.configuration)

    @cached_property
    def fared(self) -> Attempts:
        """How the leading configuration fared on all models that ran it."""
        return attempts(self.attempts, self.filters.leading)

    @cached_property
    def parts(self) -> Mapping[str, tuple[Share, ...]]:
        """The breakdown of that figure by each of PARTS."""
        return {by: breakdown(self.rows, by, self.filters.configuration) for by in PARTS}


def attempts(rows: Iterable[Attempt], configuration: str = BEST) -> Attempts:
    """How CONFIGURATION fared on the device models of ROWS."""
    models: dict[str, tuple[int, int, int]] = {}
    for row in rows:
        if row.configuration != configuration:
            continue
        counts = (row.networks, row.networks_failed, row.networks_lost)
        if row.device.simulated:
            counts = (row.sessions, row.failed, row.lost)
        elif row.networks < settings.FRONTRUNNER_QUORUM:
            continue
        # Of a model's processors the one that most of them ran.
        models[row.device.slug] = max(counts, models.get(row.device.slug, counts))
    return Attempts(
        devices=len(models),
        failing=sum(2 * failed >= ran for ran, failed, _ in models.values()),
        losing=sum(2 * lost >= ran for ran, _, lost in models.values()),
    )


def headline(rows: Iterable[Speedup], configuration: str = BEST) -> Headline:
    """The crowd's figure over models with a confirmed figure of CONFIGURATION (the best one for ALL)."""
    shown = _of(rows, configuration)
    counted = one_kind([row for row in shown if row.counts])
    models = _by_model(counted)
    variances = statistics.figure_variances(
        [row.units for row in counted], [row.deviation for row in counted]
    ).tolist()
    crowd = statistics.crowd_speedup(_estimates(counted, variances))
    speedups = list(models.values())
    return Headline(
        devices=len(models),
        sessions=sum(row.sessions for row in counted),
        geometric_mean=crowd.value if crowd else None,
        low=crowd.low if crowd else None,
        high=crowd.high if crowd else None,
        min=min(speedups, default=None),
        max=max(speedups, default=None),
        unconfirmed=len({row.device.slug for row in shown} - models.keys()),
    )


def model_speedups(rows: Iterable[Speedup], configuration: str = BEST) -> dict[str, float]:
    """The speedup of each model that the headline of ROWS is over, by its slug."""
    return _by_model(one_kind([row for row in _of(rows, configuration) if row.counts]))


def one_kind(rows: Sequence[Speedup]) -> list[Speedup]:
    """Of each model in ROWS the figures of one processor class and one backend, the preferred ones."""
    best: dict[str, tuple[bool, int]] = {}
    for row in rows:
        kind = preference(row)
        best[row.device.slug] = min(kind, best.get(row.device.slug, kind))
    return [row for row in rows if preference(row) == best[row.device.slug]]


def group_of(row: Speedup | Attempt, by: str) -> str:
    """The group of ROW in a breakdown BY "vendor" (of the chip that computed), "backend", "soc", "gpu" or
    "os".
    """
    return str(getattr(row if by in ("vendor", "backend") else row.device, by))


def _estimates(rows: Sequence[Speedup], variances: Sequence[float]) -> list[tuple[float, float]]:
    """Log ratio and variance of each model in ROWS: the mean over its figures where it has several."""
    found: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for row, variance in zip(rows, variances, strict=True):
        found[row.device.slug].append((math.log(row.speedup), variance))
    return [
        (
            math.fsum(log for log, _ in each) / len(each),
            math.fsum(variance for _, variance in each) / len(each) ** 2,
        )
        for each in found.values()
    ]


def breakdown(rows: Iterable[Speedup], by: str, configuration: str = BEST) -> tuple[Share, ...]:
    """The headline of each group of ROWS, most devices first; BY as `group_of` has it. A model measured on
    several vendors' chips, or with several backends, counts with each.
    """
    groups: dict[str, list[Speedup]] = defaultdict(list)
    for row in _of(rows, configuration):
        groups[group_of(row, by)].append(row)
    shares = (Share(group, headline(members, configuration)) for group, members in groups.items())
    return tuple(sorted(shares, key=lambda share: (-share.figure.devices, share.group)))


def place(rows: Iterable[Speedup], slug: str, configuration: str = BEST) -> Place | None:
    """Where the device SLUG stands among the models in the headline of ROWS; None where it is not in it."""
    counted = one_kind([row for row in _of(rows, configuration) if row.counts])
    devices = {row.device.slug: row.device for row in counted}
    models = _by_model(counted)
    if slug not in models:
        return None
    own = models[slug]
    ordered = sorted(models, key=lambda name: (-models[name], name))
    slower = sum(speedup < own for speedup in models.values())
    return Place(
        device=devices[slug],
        speedup=own,
        rank=1 + sum(speedup > own for speedup in models.values()),
        slower=slower / (len(models) - 1) if len(models) > 1 else None,
        models=tuple((devices[name], models[name]) for name in ordered),
    )


def _of(rows: Iterable[Speedup], configuration: str) -> list[Speedup]:
    """Those of ROWS that show CONFIGURATION, or the best one for ALL."""
    name = BEST if configuration == ALL else configuration
    return [row for row in rows if row.configuration == name]


def _by_model(rows: Iterable[Speedup]) -> dict[str, float]:
    """Each model's speedup, the geometric mean over its processors, by its slug."""
    found: dict[str, list[float]] = defaultdict(list)
    for row in rows:
        found[row.device.slug].append(row.speedup)
    return {slug: statistics.geometric_mean(values) for slug, values in found.items()}
