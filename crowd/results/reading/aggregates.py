"""Aggregates over filtered figures: the headline, breakdowns and rankings. Pure functions of rows."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

from django.conf import settings

from crowd.records.device import Device
from crowd.records.speedup import Speedup
from crowd.results.figures import networks, statistics
from crowd.results.reading.backends import preference
from crowd.results.reading.queries.filters import ALL, SpeedupFilters
from crowd.results.reading.rows import BreakdownRow, CohortOutcome, Gain, Headline, ModelOutcomes, Ranking
from crowd.results.validity.plausibility import WIDEST_BOUNDS, Bounds
from wire.front import BEST

BREAKDOWNS = ("vendor", "backend", "soc", "os")


@dataclass(frozen=True)
class Speedups:
    """The filtered figures, fastest first, and their front (None: no front is published).

    `bounds`: the possible log ratios by configuration; those of any front where one is missing.
    """

    filters: SpeedupFilters
    front: str | None
    rows: tuple[Speedup, ...]
    outcomes: tuple[CohortOutcome, ...]  # of every configuration
    bounds: Mapping[str, Bounds] = field(default_factory=dict)

    @cached_property
    def headline(self) -> Headline:
        """The headline of the configuration that the filters name."""
        return self.headline_of(self.filters.configuration)

    def headline_of(self, configuration: str) -> Headline:
        """The headline of `configuration`, one of the filtered ones."""
        return headline(self.rows, configuration, self.bounds)

    @cached_property
    def outcome_counts(self) -> ModelOutcomes:
        """How many models failed or lost the camera with the headline's configuration."""
        return model_outcomes(self.outcomes, self.filters.headline_configuration)

    @cached_property
    def breakdowns(self) -> Mapping[str, tuple[BreakdownRow, ...]]:
        """The breakdown of the headline by each of BREAKDOWNS."""
        return {by: breakdown(self.rows, by, self.filters.configuration, self.bounds) for by in BREAKDOWNS}

    @cached_property
    def outcome_breakdowns(self) -> Mapping[str, Mapping[str, ModelOutcomes]]:
        """The outcomes of the headline's configuration by each of BREAKDOWNS, by group."""
        named = [row for row in self.outcomes if row.configuration == self.filters.headline_configuration]
        return {by: _outcomes_by_group(named, by, self.filters.headline_configuration) for by in BREAKDOWNS}

    @cached_property
    def models(self) -> tuple[tuple[Device, float], ...]:
        """The models of the headline with their speedups, fastest first."""
        shown = _of_configuration(self.rows, self.filters.configuration)
        counted = preferred_figures([row for row in shown if row.counts])
        devices = {row.device.slug: row.device for row in counted}
        speedups = sorted(_by_model(counted).items(), key=lambda model: (-model[1], model[0]))
        return tuple((devices[slug], speedup) for slug, speedup in speedups)

    def ranking(self, slug: str) -> Ranking | None:
        """The rank of the device `slug` among the models; None if it is not one of them."""
        entry = next((model for model in self.models if model[0].slug == slug), None)
        if entry is None:
            return None
        device, own = entry
        slower = sum(speedup < own for _, speedup in self.models)
        return Ranking(
            device=device,
            speedup=own,
            rank=1 + sum(speedup > own for _, speedup in self.models),
            slower=slower / (len(self.models) - 1) if len(self.models) > 1 else None,
            models=self.models,
        )


def _outcomes_by_group(
    rows: Iterable[CohortOutcome], by: str, configuration: str
) -> dict[str, ModelOutcomes]:
    groups: dict[str, list[CohortOutcome]] = defaultdict(list)
    for row in rows:
        groups[group_name(row, by)].append(row)
    return {group: model_outcomes(members, configuration) for group, members in groups.items()}


def model_outcomes(rows: Iterable[CohortOutcome], configuration: str = BEST) -> ModelOutcomes:
    """How many device models of `rows` failed or lost the camera with `configuration`."""
    models: dict[str, tuple[int, int, int]] = {}
    for row in rows:
        counts = (row.counts.networks, row.counts.networks_failed, row.counts.networks_lost)
        if row.configuration != configuration or row.counts.networks < settings.FRONTRUNNER_QUORUM:
            continue
        # Of a model's processors, the one with the most networks.
        models[row.device.slug] = max(counts, models.get(row.device.slug, counts))
    return ModelOutcomes(
        devices=len(models),
        failing=sum(2 * failed >= ran for ran, failed, _ in models.values()),
        losing=sum(2 * lost >= ran for ran, _, lost in models.values()),
    )


def headline(
    rows: Iterable[Speedup], configuration: str = BEST, bounds: Mapping[str, Bounds] = MappingProxyType({})
) -> Headline:
    """The mean speedup over models with a confirmed figure of `configuration` (for ALL: of `best`).

    `bounds`: the possible log ratios by configuration.
    """
    shown = _of_configuration(rows, configuration)
    counted = preferred_figures([row for row in shown if row.counts])
    models: dict[str, list[Speedup]] = defaultdict(list)
    for row in counted:
        models[row.device.slug].append(row)
    unconfirmed = len({row.device.slug for row in shown} - models.keys())
    if not models:
        return Headline(unconfirmed=unconfirmed)
    weighed = networks.weigh(
        [[(row.estimate, row.unit_logs) for row in figures] for figures in models.values()],
        bounds.get(counted[0].configuration, WIDEST_BOUNDS),
        settings.FRONTRUNNER_QUORUM,
    )
    crowd = statistics.crowd_speedup(weighed.figures, weighed.weights)
    speedups = list(_by_model(counted).values())
    return Headline(
        devices=len(models),
        sessions=sum(row.sessions for row in counted),
        mean=crowd.measured.value if crowd else None,
        low=crowd.measured.low if crowd else None,
        high=crowd.measured.high if crowd else None,
        all_low=crowd.population.low if crowd else None,
        all_high=crowd.population.high if crowd else None,
        geometric_mean=statistics.geometric_mean(speedups),
        median=statistics.geometric_median(speedups, weighed.weights.tolist()),
        min=min(speedups),
        max=max(speedups),
        unconfirmed=unconfirmed,
        networks=weighed.networks,
        range=counted[0].range if len(counted) == 1 else None,
    )


def gain(rows: Iterable[Speedup], faster: str, slower: str) -> Gain | None:
    """The gain of the configuration `faster` over `slower`, each model once; None if no model has both.

    Both are figures of one processor and backend: of several, the preferred ones of the headline.
    """
    counted = {(_cohort(row), row.configuration): row for row in rows if row.counts}
    both = [row for (cohort, name), row in counted.items() if name == faster and (cohort, slower) in counted]
    ratios: dict[str, list[float]] = defaultdict(list)
    for row in preferred_figures(both):
        ratios[row.device.slug].append(row.speedup / counted[_cohort(row), slower].speedup)
    if not ratios:
        return None
    models = [statistics.geometric_mean(values) for values in ratios.values()]
    return Gain(len(models), statistics.geometric_mean(models), min(models), max(models))


def _cohort(row: Speedup) -> tuple[str, str, str, str, str]:
    return row.device.slug, row.front, row.backend, row.processor, row.processor_class


def preferred_figures(rows: Sequence[Speedup]) -> list[Speedup]:
    """The figures of each model in `rows` with its preferred processor class and backend."""
    best: dict[str, tuple[bool, int]] = {}
    for row in rows:
        kind = preference(row)
        best[row.device.slug] = min(kind, best.get(row.device.slug, kind))
    return [row for row in rows if preference(row) == best[row.device.slug]]


def group_name(row: Speedup | CohortOutcome, by: str) -> str:
    """The group of `row` in a breakdown `by` vendor (of the chip that computed), backend, soc, gpu or os."""
    return str(getattr(row if by in ("vendor", "backend") else row.device, by))


def breakdown(
    rows: Iterable[Speedup],
    by: str,
    configuration: str = BEST,
    bounds: Mapping[str, Bounds] = MappingProxyType({}),
) -> tuple[BreakdownRow, ...]:
    """The headline of each group of `rows`, most devices first. `by` as in `group_name`, `bounds` as in
    `headline`.

    A model that was measured on chips of several vendors, or with several backends, counts in each group.
    """
    groups: dict[str, list[Speedup]] = defaultdict(list)
    for row in _of_configuration(rows, configuration):
        groups[group_name(row, by)].append(row)
    shares = (
        BreakdownRow(group, headline(members, configuration, bounds)) for group, members in groups.items()
    )
    return tuple(sorted(shares, key=lambda share: (-share.figure.devices, share.group)))


def _of_configuration(rows: Iterable[Speedup], configuration: str) -> list[Speedup]:
    """The `rows` of `configuration`; for ALL, those of `best`."""
    name = BEST if configuration == ALL else configuration
    return [row for row in rows if row.configuration == name]


def _by_model(rows: Iterable[Speedup]) -> dict[str, float]:
    """The speedup of each model by slug: the geometric mean over its processors."""
    speedups: dict[str, list[float]] = defaultdict(list)
    for row in rows:
        speedups[row.device.slug].append(row.speedup)
    return {slug: statistics.geometric_mean(values) for slug, values in speedups.items()}
