"""Reads for those who watch an exploration: how far it is, who measures, what failed, what was found.

`watch` is cheap, a few counts, and shows by its digests whether anything changed; `found` has every
measurement, and reads only what it has not read before.
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
from crowd.explorations.outcomes.readings import Found, kept
from crowd.explorations.searching import ratios
from crowd.explorations.searching.search import COPIED, FINISHED, SEARCHED

State, Phase = Evaluation.State, Evaluation.Phase
RECENT = 50  # measurements from which the time left is judged
AGES_EVERY = 15  # seconds after which a page shows again since when somebody measures
SILENT = timedelta(minutes=2)  # a device unheard of for so long has no worker
MOST_REASONS = 10


@dataclass(frozen=True)
class Failure:
    """A reason why configurations could not be measured, how often, and the first evaluation it struck."""

    reason: str
    count: int
    example: int


@dataclass(frozen=True)
class Watch:
    """An exploration as it is now.

    `phases` counts the finished measurements of each phase, failed ones too; `searched` and `budget` are
    measurements that the search chose. `waiting` is asked for and not begun. `seconds_left` is the median
    duration a sequence of the last measurements times the sequences still to run (None: nothing to judge by,
    or it does not run). `unserved` says that work waits and no worker of the device was heard of lately.
    `version` changes with anything that a page shows, `results` with what was measured only.
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
        """Whether a page should look again: only what is done or cancelled for good stands still."""
        return self.exploration.state in (Exploration.State.RUNNING, Exploration.State.PAUSED) or bool(
            self.running
        )


def watch(key: int) -> Watch | None:
    """The exploration with that key as it is now, None if there is none. Six queries at most."""
    exploration = Exploration.objects.select_related("reference_device").filter(pk=key).first()
    if exploration is None:
        return None
    own = Evaluation.objects.filter(exploration_id=key).exclude(phase__in=COPIED)
    groups = list(
        own.values("phase", "state")
        .annotate(
            rows=Count("pk"),
            attempts=Sum("attempt"),
            last=Max("finished_at"),
            ratios=Count("ratio_filled_at"),
        )
        .order_by("phase", "state")
    )
    counts = {(group["phase"], group["state"]): group["rows"] for group in groups}
    running = tuple(own.filter(state=State.RUNNING).order_by("started_at"))
    phases = {
        phase.value: sum(counts.get((phase, state), 0) for state in FINISHED)
        for phase in Phase
        if phase not in COPIED
    }
    searched = sum(phases[phase] for phase in SEARCHED)
    waiting = sum(rows for (_, state), rows in counts.items() if state == State.PENDING)
    asked = waiting + len(running)
    repeats = sum(counts.get((Phase.REPEAT, state), 0) for state in (State.PENDING, State.RUNNING))
    failed = sum(rows for (_, state), rows in counts.items() if state == State.FAILED)
    unserved = _unserved(exploration, waiting, running)
    # How long somebody measures and was not heard of is shown, so time alone changes a page then.
    ages = [int(timezone.now().timestamp() / AGES_EVERY), *((row.pk, row.attempt) for row in running)]
    return Watch(
        exploration=exploration,
        phases=phases,
        finished=sum(phases.values()),
        failed=failed,
        searched=searched,
        waiting=waiting,
        running=running,
        failures=_failures(key) if failed else (),
        seconds_left=_seconds_left(exploration, phases, searched, asked - repeats, repeats),
        unserved=unserved,
        version=_digest([*_setting(exploration), *groups, unserved, *(ages if running else [])]),
        results=_digest([*_setting(exploration), *(group for group in groups if group["last"])]),
    )


def found(seen: Watch) -> Found:
    """What the exploration SEEN had measured then. Two queries at most, none if it was asked before."""
    return kept(seen.exploration.pk, seen.exploration.created_at).found(seen.exploration, seen.results)


def _failures(key: int) -> tuple[Failure, ...]:
    rows = (
        Evaluation.objects.filter(exploration_id=key, state=State.FAILED)
        .exclude(phase__in=COPIED)
        .order_by()
        .values("error")
        .annotate(rows=Count("pk"), first=Min("number"))
        .order_by("-rows", "first")
    )
    return tuple(Failure(row["error"], row["rows"], row["first"]) for row in rows[:MOST_REASONS])


def _seconds_left(
    exploration: Exploration, phases: dict[str, int], searched: int, asked: int, asked_again: int
) -> float | None:
    """ASKED measurements of the search and ASKED_AGAIN repeats are unfinished.

    All are counted in sequences: a repeat also runs over those held out.
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
        for phase, started, finished in last.values_list("phase", "started_at", "finished_at")[:RECENT]
        if started is not None and finished is not None
    ]
    if not durations:
        return None
    again = (exploration.points + phases[Phase.GIVEN]) * exploration.repeats
    left = max(0, exploration.budget - searched)
    defaults = ceil(left / exploration.batch) if ratios.used(exploration) else 0
    to_do = max(left + defaults, asked) * learned
    to_do += max(again - phases[Phase.REPEAT], asked_again) * every
    return median(durations) * to_do / exploration.reference_device.machines


def _unserved(exploration: Exploration, waiting: int, running: Sequence[Evaluation]) -> bool:
    if exploration.state != Exploration.State.RUNNING or running or not waiting:
        return False
    device = exploration.reference_device
    last = Evaluation.objects.filter(exploration__reference_device=device).aggregate(
        heard=Max("heartbeat_at"), finished=Max("finished_at", filter=~Q(phase__in=COPIED))
    )
    heard = [moment for moment in (device.seen_at, last["heard"], last["finished"]) if moment is not None]
    return not heard or timezone.now() - max(heard) > SILENT


def _setting(exploration: Exploration) -> list[Any]:
    known = [exploration.pk, exploration.state, exploration.budget, exploration.note]
    return [*known, exploration.reference_device.machines]


def _digest(facts: list[Any]) -> str:
    return hashlib.sha256(repr(facts).encode()).hexdigest()[:32]
