"""The live status of an exploration: progress, workers, failures and results.

`watch` is cheap: a few counts, and digests that show whether anything changed. `results_of` returns all
measurements, and reads only new ones.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import timedelta
from math import ceil
from statistics import median
from typing import Any

from django.db.models import Count, F, Max, Min, Q, Sum
from django.utils import timezone

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.outcomes.results_cache import SearchResults, cache_of
from crowd.explorations.searching import ratios
from crowd.explorations.searching.search import COPIED, FINISHED, SEARCHED

State, Phase = Evaluation.State, Evaluation.Phase
RECENT_MEASUREMENTS = 50  # measurements that predict the remaining time
AGES_EVERY = 15  # seconds between updates of the durations on a page
SILENT_AFTER = timedelta(minutes=2)  # a device without a sign of life for so long has no worker
MAX_REASONS = 10


@dataclass(frozen=True)
class Failure:
    """A reason of failures, their count, and the number of the first one."""

    reason: str
    count: int
    example: int


@dataclass(frozen=True)
class ExplorationStatus:
    """The current state of an exploration.

    `phases`: finished measurements by phase, failed ones included. `searched`: measurements that the search
    chose. `waiting`: pending ones. `seconds_left`: the median duration per sequence of the last measurements
    times the remaining sequences; None without measurements, or if it does not run. `unserved`: work is
    pending but no worker of the device showed up lately. `version` changes with anything that a page shows,
    `results` only with measurements.
    """

    exploration: Exploration
    phases: dict[str, int]
    finished: int
    failed: int
    searched: int
    waiting: int
    running: tuple[Evaluation, ...]
    failures: tuple[Failure, ...]
    seconds_left: float | None
    unserved: bool
    version: str
    results: str

    @property
    def active(self) -> bool:
        """Whether a page should refresh: the exploration is not done or cancelled."""
        return self.exploration.state in (Exploration.State.RUNNING, Exploration.State.PAUSED) or bool(
            self.running
        )


def watch(key: int) -> ExplorationStatus | None:
    """The status of the exploration with that key; None if unknown. At most six queries."""
    exploration = Exploration.objects.select_related("reference_device").filter(pk=key).first()
    if exploration is None:
        return None
    evaluations = Evaluation.objects.filter(exploration_id=key).exclude(phase__in=COPIED)
    groups = list(
        evaluations.values("phase", "state")
        .annotate(
            rows=Count("pk"),
            attempts=Sum("attempt"),
            last=Max("finished_at"),
            ratios=Count("ratio_filled_at"),
        )
        .order_by("phase", "state")
    )
    counts = {(group["phase"], group["state"]): group["rows"] for group in groups}
    running = tuple(evaluations.filter(state=State.RUNNING).order_by("started_at"))
    phases = {
        phase.value: sum(counts.get((phase, state), 0) for state in FINISHED)
        for phase in Phase
        if phase not in COPIED
    }
    searched = sum(phases[phase] for phase in SEARCHED)
    waiting = sum(rows for (_, state), rows in counts.items() if state == State.PENDING)
    unfinished = waiting + len(running)
    repeats = sum(counts.get((Phase.REPEAT, state), 0) for state in (State.PENDING, State.RUNNING))
    failed = sum(rows for (_, state), rows in counts.items() if state == State.FAILED)
    unserved = _unserved(exploration, waiting, running)
    # Durations of running measurements are shown, so the page changes with time.
    ages = [int(timezone.now().timestamp() / AGES_EVERY), *((row.pk, row.attempt) for row in running)]
    return ExplorationStatus(
        exploration=exploration,
        phases=phases,
        finished=sum(phases.values()),
        failed=failed,
        searched=searched,
        waiting=waiting,
        running=running,
        failures=_failures(key) if failed else (),
        seconds_left=_seconds_left(exploration, phases, searched, unfinished - repeats, repeats),
        unserved=unserved,
        version=_digest([*_settings(exploration), *groups, unserved, *(ages if running else [])]),
        results=_digest([*_settings(exploration), *(group for group in groups if group["last"])]),
    )


def results_of(seen: ExplorationStatus) -> SearchResults:
    """The results of the exploration `seen` at that time. At most two queries, none if cached."""
    return cache_of(seen.exploration.pk, seen.exploration.created_at).found(seen.exploration, seen.results)


def _failures(key: int) -> tuple[Failure, ...]:
    rows = (
        Evaluation.objects.filter(exploration_id=key, state=State.FAILED)
        .exclude(phase__in=COPIED)
        .order_by()
        .values("error")
        .annotate(rows=Count("pk"), first=Min("number"))
        .order_by("-rows", "first")
    )
    return tuple(Failure(row["error"], row["rows"], row["first"]) for row in rows[:MAX_REASONS])


def _seconds_left(
    exploration: Exploration, phases: dict[str, int], searched: int, unfinished: int, unfinished_repeats: int
) -> float | None:
    """The remaining seconds; `unfinished` measurements of the search and `unfinished_repeats` are in the
    queue.

    All are counted in sequences: repeats also run over held-out ones.
    """
    if exploration.state != Exploration.State.RUNNING:
        return None
    last = Evaluation.objects.filter(exploration=exploration, started_at__isnull=False).order_by(
        F("finished_at").desc(nulls_last=True)
    )
    learned = len(exploration.learned_on)
    every = learned + len(exploration.held_out_sequences)
    durations = [
        (finished - started).total_seconds() / (every if phase == Phase.REPEAT else learned)
        for phase, started, finished in last.values_list("phase", "started_at", "finished_at")[
            :RECENT_MEASUREMENTS
        ]
        if started is not None and finished is not None
    ]
    if not durations:
        return None
    again = (exploration.points + phases[Phase.GIVEN]) * exploration.repeats
    left = max(0, exploration.budget - searched)
    defaults = ceil(left / exploration.batch) if ratios.uses_ratio(exploration) else 0
    to_do = max(left + defaults, unfinished) * learned
    to_do += max(again - phases[Phase.REPEAT], unfinished_repeats) * every
    return median(durations) * to_do / exploration.reference_device.machines


def _unserved(exploration: Exploration, waiting: int, running: Sequence[Evaluation]) -> bool:
    if exploration.state != Exploration.State.RUNNING or running or not waiting:
        return False
    device = exploration.reference_device
    last = Evaluation.objects.filter(exploration__reference_device=device).aggregate(
        heard=Max("heartbeat_at"), finished=Max("finished_at", filter=~Q(phase__in=COPIED))
    )
    heard = [moment for moment in (device.seen_at, last["heard"], last["finished"]) if moment is not None]
    return not heard or timezone.now() - max(heard) > SILENT_AFTER


def _settings(exploration: Exploration) -> list[Any]:
    fields = [exploration.pk, exploration.state, exploration.budget, exploration.note]
    return [*fields, exploration.reference_device.machines]


def _digest(facts: list[Any]) -> str:
    return hashlib.sha256(repr(facts).encode()).hexdigest()[:32]
