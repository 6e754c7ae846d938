"""Celery's scheduler of periodic tasks, for clocks that are set back.

Celery orders tasks by the clock, and keeps the time of their last run: after the clock was set back an hour,
most tasks would not run for an hour.
"""

from datetime import datetime
from typing import Any

from celery.beat import PersistentScheduler


class Scheduler(PersistentScheduler):  # type: ignore[misc]  # Celery has no types
    """Orders the tasks again when the clock was set back, and after a start."""

    _latest: datetime | None = None

    def tick(self, *args: Any, **kwargs: Any) -> float:
        """Run what is due; returns the seconds until the next look."""
        now = self.app.now()
        if self._latest is None or now < self._latest:
            for entry in self.schedule.values():
                entry.last_run_at = min(entry.last_run_at, now)
            self._heap = None
        self._latest = now
        return float(super().tick(*args, **kwargs))
