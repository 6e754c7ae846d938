"""Summaries become figures: one for each configuration of a cohort, with what hides a session from it."""

import math
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime
from itertools import groupby
from operator import itemgetter
from statistics import fmean
from typing import Any, NamedTuple
from uuid import UUID

from django.conf import settings
from django.db.models import Avg, Count, F, Max, Min, Q, QuerySet, Sum

from crowd.devices import revision
from crowd.fronts.models import Configuration
from crowd.fronts.selectors import DEFAULT, predicted_speedup
from crowd.results.figures import confirmation, statistics
from crowd.results.models import Cohort, DeviceSpeedup, Outcome, SessionSummary, State
from crowd.results.validity import plausibility, rules, version
from crowd.results.validity.measures import AGREEMENT

STORED = (
    "baseline", "algorithm", "speedup", "low", "high", "session_low", "session_high", "repeat_low",
    "repeat_high", "deviation", "units", "witnesses", "unsettled", "sessions", "installations", "ate_max",
    "state", "last_session_at", "computed_at",
)  # fmt: skip
# Summaries whose state depends on others of their cohort; each time all of them are looked at again.
DEPENDING = (rules.OUTLIER.code, rules.IMPLAUSIBLE_SPEEDUP.code)

# What makes a cohort, and the figures of it.
GROUP = ("device_id", "front_id", "backend", "processor", "processor_class")
Group = tuple[int, int, str, str, str]

# An installation's key, or that of its network where it is known: what counts once.
Unit = UUID | str


@dataclass(frozen=True)
class Key:
    """What one figure is about, as primary keys."""

    cohort: int
    configuration: int
    baseline: int


@dataclass(frozen=True)
class Figure:
    """A device model's speedup with its counts. Suspect when no valid session stands behind it.

    `session`: the interval (log ratios) of the one session behind it, None for several, or where it has none.
    """

    model: statistics.ModelSpeedup
    witnesses: int
    session: tuple[float, float] | None
    ate_max: float | None
    state: State
    last_session_at: datetime

    @property
    def numbers(self) -> dict[str, Any]:
        """Ratios, intervals, counts and error by the names under which they are stored and shown."""
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
            "witnesses": self.witnesses,
            "sessions": model.sessions,
            "installations": model.installations,
            "ate_max": self.ate_max,
        }


class OutcomeCounts(NamedTuple):
    """How many sessions ran a configuration, in how many of these a run failed, or lost the camera; the same
    of the known networks that they come from.
    """

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


def group_of(cohort: Cohort) -> Group:
    """The values of GROUP that COHORT has."""
    return cohort.device_id, cohort.front_id, cohort.backend, cohort.processor, cohort.processor_class


def lock(cohorts: QuerySet[Cohort]) -> list[Cohort]:
    """COHORTS, locked until the transaction ends.

    Taken in one order, and after the locks on sessions, so that no two writers wait for each other.
    """
    return list(cohorts.select_for_update().order_by("pk"))


class Plausibility:
    """Which speedups are plausible, by the configuration. What is known of one is read once."""

    def __init__(self) -> None:
        self._predicted: dict[int, dict[int, float]] = {}
        self._reached: dict[tuple[int, str], list[tuple[float, int]]] = {}

    def bounds(self, cohort: Cohort, configuration: int) -> plausibility.Bounds:
        """Between which log ratios a session of COHORT with CONFIGURATION is plausible."""
        if cohort.front_id not in self._predicted:
            self._predicted[cohort.front_id] = _predicted(cohort.front_id)
        key = (configuration, cohort.backend)
        if key not in self._reached:
            self._reached[key] = _reached(*key)
        reached = self._reached[key]
        others = (
            next((speedup for speedup, device in rows if device != cohort.device_id), None)
            for rows in (reached, reversed(reached))
        )
        return plausibility.plausible_range(
            self._predicted[cohort.front_id].get(configuration),
            [math.log(speedup) for speedup in others if speedup],
        )


def refresh(cohorts: Iterable[Cohort], plausible: Plausibility | None = None) -> None:
    """Compute the figures of COHORTS, which the caller has locked. Cohorts without sessions are deleted."""
    plausible = plausible or Plausibility()
    by_key = {cohort.pk: cohort for cohort in cohorts}
    for cohort in by_key.values():
        judge_among_others(cohort, SessionSummary.objects.filter(cohort=cohort), plausible)
    summaries = SessionSummary.objects.filter(cohort__in=by_key)
    _store(by_key, figures(summaries))
    counts = outcomes(summaries)
    _store_outcomes(by_key, counts)
    left = {cohort for cohort, _ in counts}
    Cohort.objects.filter(pk__in=by_key.keys() - left).delete()
    Cohort.objects.filter(pk__in=left, stale=True).update(stale=False)
    if by_key:
        revision.bump()


def figures(summaries: QuerySet[SessionSummary]) -> dict[Key, Figure]:
    """The figure of every key that SUMMARIES hold a usable session of.

    One query, which answers a row for each installation, however many sessions it sent. Valid sessions make
    the figure; suspect ones do only where there is no valid session. Others never count.
    """
    groups: dict[Key, dict[str, list[_Installation]]] = defaultdict(lambda: defaultdict(list))
    for row in _by_installation(summaries):
        key = Key(row["cohort_id"], row["configuration_id"], row["baseline_id"])
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
    """How each configuration fared, by cohort and configuration. All of SUMMARIES, whatever their state.
    One query.
    """
    known = ~Q(installation__network="")
    failed, lost = Q(failed__gt=0), Q(lost__gt=0)
    rows = (
        summaries.order_by()
        .values_list("cohort_id", "configuration_id")
        .annotate(
            sessions=Count("pk"),
            failures=Count("pk", filter=failed),
            losses=Count("pk", filter=lost),
            networks=Count("installation__network", filter=known, distinct=True),
            networks_failed=Count("installation__network", filter=known & failed, distinct=True),
            networks_lost=Count("installation__network", filter=known & lost, distinct=True),
        )
    )
    return {(cohort, configuration): OutcomeCounts(*counts) for cohort, configuration, *counts in rows}


def judge_among_others(cohort: Cohort, summaries: QuerySet[SessionSummary], plausible: Plausibility) -> None:
    """Give the valid sessions of COHORT, whose SUMMARIES these are, the states that others decide.

    Outside the usual range of its units a session is an outlier, outside of what the front and other models
    make plausible it is suspect; in both cases until a session of another unit agrees. All of them are looked
    at, whatever was decided before, so that the outcome does not depend on it.
    """
    judged = summaries.filter(Q(state=State.VALID) | Q(reason__in=DEPENDING)).exclude(log_ratio=None)
    means = list(
        judged.order_by("configuration_id")
        .values_list("configuration_id", "installation_id", "installation__network")
        .annotate(mean=Avg("log_ratio"), hidden=Count("pk", filter=Q(reason__in=DEPENDING)))
    )
    networks = {who: network for _, who, network, *_ in means if network}
    wanted: dict[tuple[State, str], list[int]] = defaultdict(list)
    for configuration, rows in groupby(means, key=itemgetter(0)):
        own = list(rows)
        units: dict[Unit, list[float]] = defaultdict(list)
        for _, who, _, mean, _ in own:
            units[networks.get(who, who)].append(mean)
        usual = statistics.usual_range([fmean(logs) for logs in units.values()])
        ranges = Ranges(usual or (-math.inf, math.inf), plausible.bounds(cohort, configuration))
        near = Q(log_ratio__lt=ranges.low + AGREEMENT) | Q(log_ratio__gt=ranges.high - AGREEMENT)
        if any(hidden for *_, hidden in own):
            near |= Q(reason__in=DEPENDING)
        # Not in the order of keys: SQLite would go through the summaries of all cohorts for it.
        candidates = judged.filter(near, configuration=configuration).order_by()
        found = list(candidates.values_list("pk", "installation_id", "log_ratio", "state", "reason"))
        sessions = [(networks.get(who), who, log) for _, who, log, _, _ in found if log is not None]
        for (key, _, _, *present), rule in zip(found, _broken(sessions, ranges), strict=True):
            verdict = (State.VALID, "") if rule is None else (rule.state, rule.code)
            if present[1] != rules.RELEASED.code and verdict != tuple(present):
                wanted[verdict].append(key)
    for (state, reason), keys in wanted.items():
        change(summaries, keys, state, reason)


@dataclass(frozen=True)
class Ranges:
    """Between which log ratios a session is usual for its cohort, and plausible at all."""

    usual: tuple[float, float]
    plausible: tuple[float, float]

    @property
    def low(self) -> float:
        return max(self.usual[0], self.plausible[0])

    @property
    def high(self) -> float:
        return min(self.usual[1], self.plausible[1])


def _broken(sessions: Sequence[tuple[str | None, UUID, float]], ranges: Ranges) -> list[rules.Rule | None]:
    """The rule that each of SESSIONS (network, installation, log ratio) breaks beside the others.

    SESSIONS hold all of their cohort that lie outside RANGES or within AGREEMENT of their ends.
    """
    alone = statistics.without_agreement([(network or who, log) for network, who, log in sessions])
    backed = plausibility.corroborated([(network, log) for network, _, log in sessions])
    found: list[rules.Rule | None] = []
    for (_, _, log), lonely, supported in zip(sessions, alone, backed, strict=True):
        if lonely and not ranges.usual[0] <= log <= ranges.usual[1]:
            found.append(rules.OUTLIER)
        elif not supported and not ranges.plausible[0] <= log <= ranges.plausible[1]:
            found.append(rules.IMPLAUSIBLE_SPEEDUP)
        else:
            found.append(None)
    return found


def _reached(configuration: int, backend: str) -> list[tuple[float, int]]:
    """The confirmed speedups of CONFIGURATION with BACKEND, ascending, each with its device. One query."""
    rows = DeviceSpeedup.objects.filter(
        configuration=configuration,
        backend=backend,
        witnesses__gte=settings.FRONTRUNNER_QUORUM,
        state=State.VALID,
    )
    return sorted(rows.order_by().values_list("speedup", "device_id"))


def _predicted(front: int) -> dict[int, float]:
    """How many times faster than the default each configuration of FRONT was on its reference device, by the
    configuration's key.
    """
    rows = Configuration.objects.filter(front=front).values_list("pk", "name", "predicted")
    default: Mapping[str, Any] = next((predicted for _, name, predicted in rows if name == DEFAULT), {})
    speedups = {key: predicted_speedup(default, predicted) for key, _, predicted in rows}
    return {key: speedup for key, speedup in speedups.items() if speedup is not None}


def change(summaries: QuerySet[SessionSummary], keys: Collection[int], state: State, reason: str) -> None:
    """Give the summaries KEYS a state, and find again which of their days' sessions count."""
    if not keys:
        return
    changed = summaries.filter(pk__in=keys)
    days = list(changed.values_list("installation_id", "day").distinct())
    changed.update(state=state, reason=reason)
    count_days(
        summaries.filter(installation_id__in={who for who, _ in days}, day__in={day for _, day in days})
    )


def count_days_of(places: Iterable[tuple[int, UUID, date]]) -> None:
    """Find again which sessions count on the days of PLACES: cohort, installation and day."""
    found = set(places)
    if found:
        cohorts, installations, days = zip(*found, strict=True)
        count_days(
            SessionSummary.objects.filter(cohort__in=cohorts, installation__in=installations, day__in=days)
        )


def count_days(cohort_days: QuerySet[SessionSummary]) -> None:
    """Mark which of those sessions count: the first few of each installation, day, cohort and state.

    COHORT_DAYS holds whole days.
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


def _store(cohorts: Mapping[int, Cohort], found: Mapping[Key, Figure]) -> None:
    """Replace the figures of COHORTS, by their key, with FOUND."""
    groups = {key: group_of(cohort) for key, cohort in cohorts.items()}
    present = {(*groups[key.cohort], key.configuration) for key in found}
    own = set(groups.values())
    rows = DeviceSpeedup.objects.filter(
        device__in={cohort.device_id for cohort in cohorts.values()}
    ).order_by()
    gone = {
        key: configuration
        for key, *group, configuration in rows.values_list("pk", *GROUP, "configuration_id")
        if tuple(group) in own and (*group, configuration) not in present
    }
    if gone:
        DeviceSpeedup.objects.filter(pk__in=gone).delete()
        confirmation.ask_again(set(gone.values()))
    DeviceSpeedup.objects.bulk_create(
        [
            DeviceSpeedup(
                **dict(zip(GROUP, groups[key.cohort], strict=True)),
                configuration_id=key.configuration,
                baseline_id=key.baseline,
                algorithm=version.ALGORITHM,
                **figure.numbers,
                unsettled=True,
                state=figure.state,
                last_session_at=figure.last_session_at,
            )
            for key, figure in found.items()
        ],
        update_conflicts=True,
        unique_fields=["front", "configuration", "device", "backend", "processor", "processor_class"],
        update_fields=STORED,
    )


def _store_outcomes(cohorts: Collection[int], found: Mapping[tuple[int, int], OutcomeCounts]) -> None:
    """Replace the outcomes of COHORTS, keys all, with FOUND, by cohort and configuration."""
    rows = Outcome.objects.filter(cohort__in=cohorts).order_by()
    stored, gone = {}, []
    for key, cohort, configuration, *counts in rows.values_list(
        "pk", "cohort_id", "configuration_id", *OutcomeCounts._fields
    ):
        stored[cohort, configuration] = OutcomeCounts(*counts)
        if (cohort, configuration) not in found:
            gone.append(key)
    if gone:
        Outcome.objects.filter(pk__in=gone).delete()
    Outcome.objects.bulk_create(
        [
            Outcome(cohort_id=key[0], configuration_id=key[1], **counts._asdict())
            for key, counts in found.items()
            if stored.get(key) != counts
        ],
        update_conflicts=True,
        unique_fields=["cohort", "configuration"],
        update_fields=OutcomeCounts._fields,
    )


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
            mean=Avg("log_ratio"),
            mean_square=Sum(F("log_ratio") * F("log_ratio")) / Count("id"),
            sessions=Count("id"),
            low=Min("low"),
            high=Max("high"),
            error=Max("ate_max"),
            last=Max("started_at"),
        )
    )


def _deviation(mean: float, mean_square: float, count: int) -> float:
    """Standard deviation of a sample; 0 for a single value."""
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
        witnesses=agreement.witnesses(math.log(model.speedup.value)),
        session=installations[0].session if len(installations) == 1 else None,
        ate_max=max((each.ate_max for each in installations if each.ate_max is not None), default=None),
        state=state,
        last_session_at=max(each.last_session_at for each in installations),
    )
