"""Everything that may happen to an exploration, by many hands at once, on the database of the environment.

Each hand is a thread with a connection of its own, which does its work again and again until the exploration
is done, or one of them fails.
"""

import json
import random
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from datetime import timedelta
from pathlib import Path
from typing import Any

from django.core.exceptions import ValidationError
from django.db import connection
from django.db.models import Q
from django.utils import timezone

from crowd.explorations import services
from crowd.explorations.measuring import leases, reaping
from crowd.explorations.measuring.measurement import Measurement
from crowd.explorations.models import Evaluation, Exploration
from tests.services import explorations
from tests.services.table import DEVICE, NOTHING, look_up

MACHINES = 3
BUDGETS = (16, 24, 32)  # raised from one to the next
BATCH = 4
WISHES: dict[str, Any] = {"method": "random", "batch": BATCH, "recheck": False, "repeats": 1}
DEATHS = 0.25  # of the measurements: their worker says nothing more and their lease runs out
PATIENCE_SECONDS = 300.0

Hand = Callable[[random.Random], None]


class Race:
    """An exploration, another one of the same device to be cancelled, and what the hands did."""

    def __init__(self, var: Path) -> None:
        self.exploration = explorations.create(var, machines=MACHINES, budget=BUDGETS[0], **WISHES)
        self.other = services.create(services.clone(self.exploration, seed=1))
        self.device = self.exploration.reference_device
        self.begun: list[tuple[int, int]] = []  # keys and attempts of all leases
        self.stored: list[tuple[int, int]] = []  # of those whose results were taken
        self.errors: list[str] = []
        self._over = threading.Event()

    def run(self) -> None:
        """Set all hands to work, and return when they have ended."""
        workers: list[Hand] = [*[self.work_on_a_message] * 3, *[self.work_on_the_next] * 2]
        others: list[Hand] = [self.reap, self.reap, self.ask, self.ask, self.steer, self.cancel, self.watch]
        threads = [
            threading.Thread(target=self._keep_on, args=(hand, random.Random(number)))
            for number, hand in enumerate(workers + others)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

    def work_on_a_message(self, chance: random.Random) -> None:
        """As a Celery worker, notified of an evaluation that somebody else may have by now."""
        unfinished = Evaluation.objects.filter(state__in=["pending", "running"])
        keys = list(unfinished.values_list("pk", flat=True))
        if keys:
            with suppress(leases.DeviceBusyError):
                self._measure(leases.take(chance.choice(keys), "worker"), chance)

    def work_on_the_next(self, chance: random.Random) -> None:
        """As a machine without Celery."""
        both = Q(exploration__in=(self.exploration, self.other))
        self._measure(leases.take_next(self.device, "board", both), chance)

    def reap(self, _: random.Random) -> None:
        """As the periodic task."""
        reaping.reap()

    def ask(self, _: random.Random) -> None:
        """As a worker that has finished a batch."""
        services.advance(self.exploration.pk)
        services.advance(self.other.pk)

    def steer(self, _: random.Random) -> None:
        """As an administrator who wants more whenever there is nearly all, failures once more too."""
        present = Exploration.objects.get(pk=self.exploration.pk)
        searched = present.evaluations.filter(phase="random", state__in=["done", "failed"]).count()
        larger = [budget for budget in BUDGETS if budget > present.budget]
        if larger and searched > present.budget - BATCH:
            services.raise_budget(present, larger[0])
            services.retry_failures(present)
        elif present.state == "done" and not larger:
            self._over.set()

    def cancel(self, _: random.Random) -> None:
        """As an administrator, in the middle of the other exploration."""
        if self.other.evaluations.filter(state="done").count() > BATCH:
            with suppress(ValidationError):  # it is cancelled already
                services.cancel(self.other)

    def watch(self, _: random.Random) -> None:
        """No more than its machines ever measure for the device."""
        assert leases.free_machines(self.device) >= 0

    def _measure(self, evaluation: Evaluation | None, chance: random.Random) -> None:
        if evaluation is None:
            return
        lease = evaluation.pk, evaluation.attempt
        self.begun.append(lease)
        if chance.random() < DEATHS:
            mine = Evaluation.objects.filter(pk=evaluation.pk, attempt=evaluation.attempt, state="running")
            mine.update(lease_until=timezone.now() - timedelta(hours=1))
            return
        leases.renew(evaluation)
        values = look_up(evaluation.configuration)
        if values is None:
            taken = leases.fail(evaluation, NOTHING)
        else:
            taken = leases.record(evaluation, Measurement(values, {}, DEVICE))
        if taken:
            self.stored.append(lease)

    def _keep_on(self, hand: Hand, chance: random.Random) -> None:
        limit = time.monotonic() + PATIENCE_SECONDS
        try:
            while not self._over.is_set():
                hand(chance)
                assert time.monotonic() < limit, f"not done after {PATIENCE_SECONDS:.0f} s"
        except Exception as error:
            self.errors.append(f"{hand.__name__}: {type(error).__name__}: {error}")
            self._over.set()
        finally:
            connection.close()


def run(var: str) -> None:
    """Run a race with the data folder `var`; prints the exploration's key and what the hands did, as JSON."""
    race = Race(Path(var))
    race.run()
    other = Exploration.objects.get(pk=race.other.pk)
    report = {"key": race.exploration.pk, "other": [other.pk, other.state]}
    print(json.dumps(report | {"begun": race.begun, "stored": race.stored, "errors": race.errors}))
