"""Session summaries grouped into figures of device models: where sessions become a speedup."""

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from django.db.models import Avg, Count, F, Max, QuerySet, Sum

from crowd.results.figures import statistics
from crowd.results.models import SessionSummary, State


@dataclass(frozen=True)
class Key:
    """What one figure is about, as primary keys."""

    cohort: int
    configuration: int
    baseline: int


@dataclass(frozen=True)
class Figure:
    """A device model's speedup with its counts. Suspect when no valid session stands behind it."""

    model: statistics.ModelSpeedup
    ate_max: float | None
    state: State
    last_session_at: datetime

    @property
    def numbers(self) -> dict[str, Any]:
        """Ratios, intervals, counts and error by the names under which they are stored and shown."""
        model = self.model
        return {
            "speedup": model.speedup.value,
            "low": model.speedup.low,
            "high": model.speedup.high,
            "repeat_low": model.repeat.low if model.repeat else None,
            "repeat_high": model.repeat.high if model.repeat else None,
            "sessions": model.sessions,
            "installations": model.installations,
            "ate_max": self.ate_max,
        }


@dataclass(frozen=True)
class _Installation:
    value: statistics.InstallationValue
    ate_max: float | None
    last_session_at: datetime


def figures(summaries: QuerySet[SessionSummary]) -> dict[Key, Figure]:
    """The figure of every key that SUMMARIES hold a usable session of.

    One query, which answers a row for each installation, however many sessions it sent. Valid sessions make
    the figure; suspect ones do only where there is no valid session. Others never count.
    """
    groups: dict[Key, dict[str, list[_Installation]]] = defaultdict(lambda: defaultdict(list))
    for row in _by_installation(summaries):
        key = Key(row["cohort_id"], row["configuration_id"], row["baseline_id"])
        groups[key][row["state"]].append(
            _Installation(
                statistics.InstallationValue(
                    row["mean"],
                    _deviation(row["mean"], row["mean_square"], row["sessions"]),
                    row["sessions"],
                ),
                row["error"],
                row["last"],
            )
        )
    return {
        key: _figure(states[state], state)
        for key, states in groups.items()
        for state in [State.VALID if State.VALID in states else State.SUSPECT]
    }


def valid_speedups(summaries: QuerySet[SessionSummary]) -> dict[Key, tuple[float, int]]:
    """What the figure of every key says that SUMMARIES hold a valid session of: the logarithm of the speedup,
    and from how many sessions. One query, and no interval.
    """
    groups: dict[Key, list[tuple[float, int]]] = defaultdict(list)
    for row in _by_installation(summaries.filter(state=State.VALID)):
        key = Key(row["cohort_id"], row["configuration_id"], row["baseline_id"])
        groups[key].append((row["mean"], row["sessions"]))
    return {
        key: (sum(mean for mean, _ in rows) / len(rows), sum(sessions for _, sessions in rows))
        for key, rows in groups.items()
    }


def _by_installation(summaries: QuerySet[SessionSummary]) -> Iterable[Mapping[str, Any]]:
    return (
        summaries.filter(counted=True, state__in=[State.VALID, State.SUSPECT])
        .order_by("configuration_id", "cohort_id", "installation_id")
        .values("cohort_id", "configuration_id", "baseline_id", "installation_id", "state")
        .annotate(
            mean=Avg("log_ratio"),
            mean_square=Sum(F("log_ratio") * F("log_ratio")) / Count("id"),
            sessions=Count("id"),
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
    return Figure(
        model=statistics.model_speedup([each.value for each in installations]),
        ate_max=max((each.ate_max for each in installations if each.ate_max is not None), default=None),
        state=state,
        last_session_at=max(each.last_session_at for each in installations),
    )
