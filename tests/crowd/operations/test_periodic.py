"""Periodic tasks run on time, also after the clock was set back."""

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from celery import Celery
from celery.schedules import schedule

from crowd.operations.periodic import Scheduler

NOON = datetime(2026, 11, 26, 12, tzinfo=UTC)


class Clock:
    """An application whose clock is set by hand, and the scheduler of its tasks `often` and `rarely`."""

    def __init__(self, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.moment = NOON
        self.sent: list[str] = []
        app = Celery("clock", broker="memory://", set_as_current=False)
        app.conf.beat_schedule = {
            "often": {"task": "often", "schedule": 30},
            "rarely": {"task": "rarely", "schedule": 300},
        }
        monkeypatch.setattr(app, "now", lambda: self.moment)
        monkeypatch.setattr(schedule, "now", lambda _: self.moment)
        self._app, self._path = app, path
        self.start()

    def start(self) -> None:
        self._scheduler = Scheduler(self._app, schedule_filename=str(self._path))

        self._scheduler.apply_entry = lambda entry, **_: self.sent.append(entry.name)

    def end(self) -> None:
        self._scheduler.close()

    def run(self, seconds: int) -> list[str]:
        """What is sent in that time."""
        before = len(self.sent)
        for _ in range(seconds):
            self.moment += timedelta(seconds=1)
            while self._scheduler.tick() == 0:
                pass
        return self.sent[before:]


@pytest.fixture
def clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    clock = Clock(tmp_path / "beat", monkeypatch)
    yield clock
    clock.end()


@pytest.mark.parametrize("restart", [False, True])
def test_each_task_runs_within_its_period_after_the_clock_was_set_back(clock: Clock, restart: bool) -> None:
    assert set(clock.run(305)) == {"often", "rarely"}
    clock.moment -= timedelta(days=1)
    if restart:
        clock.end()
        clock.start()

    sent = clock.run(305)
    assert sent.count("rarely") == 1
    assert sent.count("often") in (9, 10, 11)
