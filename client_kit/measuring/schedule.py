"""The remaining time of a session, from its frames so far."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field


@dataclass
class Schedule:
    """Jobs of a session, each a configuration and its number of frames; warm-ups are jobs too."""

    rest_seconds: float = 0.0
    now: Callable[[], float] = time.monotonic
    _jobs: list[tuple[str, int]] = field(default_factory=list)
    _seconds_a_frame: dict[str, float] = field(default_factory=dict)
    _began: float = 0.0

    def add(self, names: Sequence[str], frames: int) -> None:
        """Put jobs at the end."""
        self._jobs += [(name, frames) for name in names]

    def begin(self) -> None:
        """The first job begins."""
        self._began = self.now()

    def end(self) -> None:
        """The first job has ended, with or without success."""
        self._jobs.pop(0)

    def left(self, done: int) -> float | None:
        """Seconds until all jobs end, `done` frames into the first job; None before the first frame.

        A configuration that has not run yet counts as slow as the slowest so far: the estimate should not
        grow.
        """
        if not self._jobs or not done:
            return None
        name, frames = self._jobs[0]
        self._seconds_a_frame[name] = (self.now() - self._began) / done
        slowest = max(self._seconds_a_frame.values())
        later = sum(count * self._seconds_a_frame.get(job, slowest) for job, count in self._jobs[1:])
        rests = self.rest_seconds * (len(self._jobs) - 1)
        return (frames - done) * self._seconds_a_frame[name] + later + rests
