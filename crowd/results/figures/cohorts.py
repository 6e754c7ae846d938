"""Computes the figure of each configuration of a cohort from summaries, and which sessions count in it."""

import math
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date, datetime
from itertools import groupby
from operator import itemgetter
from statistics import fmean
from typing import Any, NamedTuple
from uuid import UUID

from django.db.models import Avg, Count, F, Max, Min, Q, QuerySet, Sum

from crowd.devices import revision
from crowd.results.figures import confirmation, networks, statistics
from crowd.results.figures.plausible import PlausibilityBounds
from crowd.results.models import Cohort, DeviceSpeedup, Outcome, SessionSummary, State
from crowd.results.validity import plausibility, rules, version
from crowd.results.validity.measures import AGREEMENT
from crowd.results.validity.plausibility import Bounds

FIGURE_KEY = ("front", "configuration", "device", "backend", "processor", "processor_class")
# What a new figure replaces: all but its key, and what other models with its chip add.
UPDATED_COLUMNS = [
    field.name
    for field in DeviceSpeedup._meta.concrete_fields
    if not field.primary_key and field.name not in (*FIGURE_KEY, "chip_witnesses")
]
# Rules that depend on the other sessions of the cohort. Each time, all of these sessions are judged again.
COHORT_RULES = (rules.OUTLIER.code, rules.IMPLAUSIBLE_SPEEDUP.code, rules.IMPOSSIBLE_SPEEDUP.code)

# What counts once: a network (its key) or, if that is unknown, an installation (its key).
Unit = UUID | str


class CohortKey(NamedTuple):
    """The columns that identify a cohort."""

    device_id: int
    front_id: int
    backend: str
    processor: str
    processor_class: str


KEY_COLUMNS = CohortKey._fields


@dataclass(frozen=True)
class FigureKey:
    """The cohort, configuration and baseline of a figure, as primary keys."""

    cohort: int
    configuration: int
    baseline: int


@dataclass(frozen=True)
class Figure:
    """A device model's speedup with its counts. Suspect if it has no valid session.

    `session`: the interval (log ratios) of its only session, None for several or without an interval.
    `unit_logs`: its packed units.
    """

    model: statistics.ModelSpeedup
    unit_logs: bytes
    witnesses: int
    session: tuple[float, float] | None
    ate_max: float | None
    state: State
    last_session_at: datetime

    @property
    def numbers(self) -> dict[str, Any]:
        """Ratios, intervals, counts and error by the names of their columns."""
        model = self.model
        low, high = (None, None) if self.session is None else map(math.exp, self.session)
        return {
            "speedup": model.speedup.value,
            "low": model.speedup.low,
            "high": model.speedup.high,
            "session_low": low,
            "session_high": high,
            "repeat_low": model.repeat.low if model.repeat else None,
            "repeat_high": model.repeat.high if model.repeat else None,
            "deviation": model.deviation,
            "units": model.units,
            "unit_logs": self.unit_logs,
            "witnesses": self.witnesses,
            "sessions": model.sessions,
            "installations": model.installations,
            "ate_max": self.ate_max,
        }


class OutcomeCounts(NamedTuple):
    """How many sessions, and known networks, ran a configuration, had a failed run, or lost the camera."""

    sessions: int
    failed: int
    lost: int
    networks: int
    networks_failed: int
    networks_lost: int


@dataclass(frozen=True)
class _Installation:
    value: statistics.InstallationValue
    session: tuple[float, float] | None
    ate_max: float | None
    last_session_at: datetime


def cohort_key(row: Cohort | DeviceSpeedup) -> CohortKey:
    """The key of the cohort of `row`."""
    return CohortKey(*(getattr(row, name) for name in KEY_COLUMNS))


def lock_cohorts(cohorts: QuerySet[Cohort]) -> list[Cohort]:
    """Lock `cohorts` until the transaction ends.

    They are locked in the order of keys and after sessions, to avoid deadlocks.
    """
    return list(cohorts.select_for_update().order_by("pk"))


def refresh_figures(cohorts: Iterable[Cohort], plausible: PlausibilityBounds | None = None) -> None:
    """Compute the figures of `cohorts`, which the caller has locked. Deletes cohorts without sessions."""
    plausible = plausible or PlausibilityBounds()
    by_key = {cohort.pk: cohort for cohort in cohorts}
    for cohort in by_key.values():
        judge_within_cohort(cohort, SessionSummary.objects.filter(cohort=cohort), plausible)
    summaries = SessionSummary.objects.filter(cohort__in=by_key)
    _store_figures(by_key, figures(summaries))
    counts = outcomes(summaries)
    _store_outcomes(by_key, counts)
    left = {cohort for cohort, _ in counts}
    Cohort.objects.filter(pk__in=by_key.keys() - left).delete()
    Cohort.objects.filter(pk__in=left, stale=True).update(stale=False)
    if by_key:
        revision.bump()


def figures(summaries: QuerySet[SessionSummary]) -> dict[FigureKey, Figure]:
    """The figures from the usable sessions of `summaries`.

    One query, with a row for each installation. Valid sessions count; suspect ones count only if there is no
    valid session. Others never count.
    """
    groups: dict[FigureKey, dict[str, list[_Installation]]] = defaultdict(lambda: defaultdict(list))
    for row in _by_installation(summaries):
        key = FigureKey(row["cohort_id"], row["configuration_id"], row["baseline_id"])
        only = row["sessions"] == 1 and row["low"] is not None
        groups[key][row["state"]].append(
            _Installation(
                statistics.InstallationValue(
                    row["mean"],
                    _deviation(row["mean"], row["mean_square"], row["sessions"]),
                    row["sessions"],
                    row["installation__network"] or None,
                ),
                (row["low"], row["high"]) if only else None,
                row["error"],
                row["last"],
            )
        )
    return {
        key: _figure(states[state], state)
        for key, states in groups.items()
        for state in [State.VALID if State.VALID in states else State.SUSPECT]
    }


def outcomes(summaries: QuerySet[SessionSummary]) -> dict[tuple[int, int], OutcomeCounts]:
    """Failed and lost sessions by cohort and configuration, over all `summaries` of any state. One query."""
    known_network = ~Q(installation__network="")
    failed, lost = Q(failed__gt=0), Q(lost__gt=0)
    rows = (
        summaries.order_by()
        .values_list("cohort_id", "configuration_id")
        .annotate(
            sessions=Count("pk"),
            failures=Count("pk", filter=failed),
            losses=Count("pk", filter=lost),
            networks=Count("installation__network", filter=known_network, distinct=True),
            networks_failed=Count("installation__network", filter=known_network & failed, distinct=True),
            networks_lost=Count("installation__network", filter=known_network & lost, distinct=True),
        )
    )
    return {(cohort, configuration): OutcomeCounts(*counts) for cohort, configuration, *counts in rows}


def judge_within_cohort(
    cohort: Cohort, summaries: QuerySet[SessionSummary], plausible: PlausibilityBounds
) -> None:
    """Judge the valid sessions of `cohort`, whose summaries are `summaries`, by COHORT_RULES.

    Outside the usual range of its units a session is an outlier. Outside the plausible range it is suspect.
    Both end when a session of another unit agrees. Outside the possible range it stays suspect.
    All sessions are judged, whatever was decided before, so that the order of arrival does not matter.
    """
    judged = summaries.filter(Q(state=State.VALID) | Q(reason__in=COHORT_RULES)).exclude(log_ratio=None)
    means = list(
        judged.order_by("configuration_id")
        .values_list("configuration_id", "installation_id", "installation__network")
        .annotate(mean=Avg("log_ratio"), hidden=Count("pk", filter=Q(reason__in=COHORT_RULES)))
    )
    network_of = {who: network for _, who, network, *_ in means if network}
    wanted: dict[tuple[State, str], list[int]] = defaultdict(list)
    for configuration, rows in groupby(means, key=itemgetter(0)):
        listed = list(rows)
        units: dict[Unit, list[float]] = defaultdict(list)
        for _, who, _, mean, _ in listed:
            units[network_of.get(who, who)].append(mean)
        usual = statistics.usual_range([fmean(logs) for logs in units.values()])
        ranges = Ranges(
            usual or (-math.inf, math.inf),
            plausible.plausible(cohort, configuration),
            plausible.possible(cohort, configuration),
        )
        near = Q(log_ratio__lt=ranges.low + AGREEMENT) | Q(log_ratio__gt=ranges.high - AGREEMENT)
        if any(hidden for *_, hidden in listed):
            near |= Q(reason__in=COHORT_RULES)
        # Ordered by key, SQLite would scan the summaries of all cohorts.
        candidates = judged.filter(near, configuration=configuration).order_by()
        near_sessions = list(candidates.values_list("pk", "installation_id", "log_ratio", "state", "reason"))
        sessions = [(network_of.get(who), who, log) for _, who, log, _, _ in near_sessions if log is not None]
        if not all(_within(log, ranges.possible) for *_, log in sessions):
            ranges = replace(ranges, possible=plausible.confirmed_possible(cohort, configuration))
        for (key, _, _, *present), rule in zip(near_sessions, _violated_rules(sessions, ranges), strict=True):
            verdict = (State.VALID, "") if rule is None else (rule.state, rule.code)
            if present[1] != rules.RELEASED.code and verdict != tuple(present):
                wanted[verdict].append(key)
    for (state, reason), keys in wanted.items():
        set_state(summaries, keys, state, reason)


@dataclass(frozen=True)
class Ranges:
    """The ranges of log ratios in which a session is usual for its cohort, plausible, and possible."""

    usual: Bounds
    plausible: Bounds
    possible: Bounds

    @property
    def low(self) -> float:
        return max(self.usual[0], self.plausible[0], self.possible[0])

    @property
    def high(self) -> float:
        return min(self.usual[1], self.plausible[1], self.possible[1])


def _within(log: float, bounds: Bounds) -> bool:
    return bounds[0] <= log <= bounds[1]


def _violated_rules(
    sessions: Sequence[tuple[str | None, UUID, float]], ranges: Ranges
) -> list[rules.Rule | None]:
    """The rule that each of `sessions` (network, installation, log ratio) violates.

    `sessions` contains all sessions of a cohort that are outside `ranges` or within AGREEMENT of their ends.
    """
    alone = statistics.without_agreement([(network or who, log) for network, who, log in sessions])
    backed = plausibility.corroborated([(network, log) for network, _, log in sessions])
    violated: list[rules.Rule | None] = []
    for (_, _, log), lonely, supported in zip(sessions, alone, backed, strict=True):
        if lonely and not _within(log, ranges.usual):
            violated.append(rules.OUTLIER)
        elif not _within(log, ranges.possible):
            violated.append(rules.IMPOSSIBLE_SPEEDUP)
        elif not supported and not _within(log, ranges.plausible):
            violated.append(rules.IMPLAUSIBLE_SPEEDUP)
        else:
            violated.append(None)
    return violated


def set_state(summaries: QuerySet[SessionSummary], keys: Collection[int], state: State, reason: str) -> None:
    """Set the state of the summaries `keys`, then decide again which sessions of their days count."""
    if not keys:
        return
    changed = summaries.filter(pk__in=keys)
    days = list(changed.values_list("installation_id", "day").distinct())
    changed.update(state=state, reason=reason)
    apply_daily_limit(
        summaries.filter(installation_id__in={who for who, _ in days}, day__in={day for _, day in days})
    )


def apply_daily_limit_at(day_keys: Iterable[tuple[int, UUID, date]]) -> None:
    """Decide which sessions count on `day_keys`: cohort, installation and day."""
    distinct = set(day_keys)
    if distinct:
        cohorts, installations, days = zip(*distinct, strict=True)
        apply_daily_limit(
            SessionSummary.objects.filter(cohort__in=cohorts, installation__in=installations, day__in=days)
        )


def apply_daily_limit(cohort_days: QuerySet[SessionSummary]) -> None:
    """Mark which sessions of `cohort_days` count: the first few of each installation, day, cohort and state.

    `cohort_days` must contain whole days.
    """
    rows = list(
        cohort_days.order_by("session_id").values_list(
            "pk", "counted", "cohort_id", "configuration_id", "installation_id", "day", "state", "log_ratio"
        )
    )
    usable = [row for row in rows if row[-1] is not None]
    limited = statistics.within_daily_limit(row[2:7] for row in usable)
    counted = {row[0] for row, first in zip(usable, limited, strict=True) if first}
    for value in (True, False):
        wrong = [row[0] for row in rows if (row[0] in counted) is value and row[1] is not value]
        if wrong:
            SessionSummary.objects.filter(pk__in=wrong).update(counted=value)


def _store_figures(cohorts: Mapping[int, Cohort], new_figures: Mapping[FigureKey, Figure]) -> None:
    """Replace the figures of `cohorts` (by key) with `new_figures`."""
    groups = {key: cohort_key(cohort) for key, cohort in cohorts.items()}
    present = {(*groups[key.cohort], key.configuration) for key in new_figures}
    stored = set(groups.values())
    rows = DeviceSpeedup.objects.filter(
        device__in={cohort.device_id for cohort in cohorts.values()}
    ).order_by()
    gone = {
        key: configuration
        for key, *group, configuration in rows.values_list("pk", *KEY_COLUMNS, "configuration_id")
        if tuple(group) in stored and (*group, configuration) not in present
    }
    if gone:
        DeviceSpeedup.objects.filter(pk__in=gone).delete()
        confirmation.mark_doubtful_unsettled(set(gone.values()))
    DeviceSpeedup.objects.bulk_create(
        [
            DeviceSpeedup(
                **groups[key.cohort]._asdict(),
                configuration_id=key.configuration,
                baseline_id=key.baseline,
                algorithm=version.ALGORITHM,
                **figure.numbers,
                unsettled=True,
                state=figure.state,
                last_session_at=figure.last_session_at,
            )
            for key, figure in new_figures.items()
        ],
        update_conflicts=True,
        unique_fields=FIGURE_KEY,
        update_fields=UPDATED_COLUMNS,
    )


def _store_outcomes(
    cohorts: Collection[int], outcome_counts: Mapping[tuple[int, int], OutcomeCounts]
) -> None:
    """Replace the outcomes of `cohorts` (keys) with `outcome_counts`, by cohort and configuration."""
    rows = Outcome.objects.filter(cohort__in=cohorts).order_by()
    stored, gone = {}, []
    for key, cohort, configuration, *counts in rows.values_list(
        "pk", "cohort_id", "configuration_id", *OutcomeCounts._fields
    ):
        stored[cohort, configuration] = OutcomeCounts(*counts)
        if (cohort, configuration) not in outcome_counts:
            gone.append(key)
    if gone:
        Outcome.objects.filter(pk__in=gone).delete()
    Outcome.objects.bulk_create(
        [
            Outcome(cohort_id=key[0], configuration_id=key[1], **counts._asdict())
            for key, counts in outcome_counts.items()
            if stored.get(key) != counts
        ],
        update_conflicts=True,
        unique_fields=["cohort", "configuration"],
        update_fields=OutcomeCounts._fields,
    )


class _Ordered:
    """An aggregate that adds floats in the order of sessions on PostgreSQL.

    Its sums otherwise depend on which cohorts are in the query, in their last bits. SQLite has no such order
    before its version 3.44, and one writer.
    """

    def as_postgresql(self, compiler: Any, connection: Any, **context: Any) -> Any:
        template = "%(function)s(%(distinct)s%(expressions)s ORDER BY session_id)"
        return self.as_sql(compiler, connection, template=template, **context)  # type: ignore[attr-defined]


class _OrderedAvg(_Ordered, Avg):
    pass


class _OrderedSum(_Ordered, Sum):
    pass


def _by_installation(summaries: QuerySet[SessionSummary]) -> Iterable[Mapping[str, Any]]:
    return (
        summaries.filter(counted=True, state__in=[State.VALID, State.SUSPECT])
        .order_by("configuration_id", "cohort_id", "installation_id")
        .values(
            "cohort_id",
            "configuration_id",
            "baseline_id",
            "installation_id",
            "installation__network",
            "state",
        )
        .annotate(
            mean=_OrderedAvg("log_ratio"),
            mean_square=_OrderedSum(F("log_ratio") * F("log_ratio")) / Count("id"),
            sessions=Count("id"),
            low=Min("low"),
            high=Max("high"),
            error=Max("ate_max"),
            last=Max("started_at"),
        )
    )


def _deviation(mean: float, mean_square: float, count: int) -> float:
    """The sample standard deviation; 0 for a single value."""
    if count < 2:
        return 0.0
    return math.sqrt(max(mean_square - mean * mean, 0.0) * count / (count - 1))


def _figure(installations: Sequence[_Installation], state: State) -> Figure:
    values = [each.value for each in installations]
    model = statistics.model_speedup(values)
    agreement = statistics.agreement(
        [value.network for value in values], [value.log_ratio for value in values]
    )
    return Figure(
        model=model,
        unit_logs=networks.pack(statistics.units(values)),
        witnesses=agreement.witnesses(math.log(model.speedup.value)),
        session=installations[0].session if len(installations) == 1 else None,
        ate_max=max((each.ate_max for each in installations if each.ate_max is not None), default=None),
        state=state,
        last_session_at=max(each.last_session_at for each in installations),
    )
