"""A Celery worker that serves a reference device, started as its owner does."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from tests.services.program import ROOT, Program, children
from tests.services.serving import Services, environment


class Worker(Program):
    """`celery -A crowd worker -Q `device` -c 1 OPTIONS`, which does not restart when it dies."""

    def __init__(
        self, var: Path, services: Services, device: str, number: int = 0, options: Sequence[str] = ()
    ) -> None:
        self.var, self.services, self.device, self.number = var, services, device, number
        self.options = options
        self.folder, self.log = ROOT, var / f"worker-{device}-{number}.txt"

    def command(self) -> Sequence[str]:
        name = f"{self.device}-{self.number}@localhost"
        options = ["-Q", self.device, "-c", "1", "-n", name, "--loglevel", "INFO", *self.options]
        return [sys.executable, "-m", "celery", "-A", "crowd", "worker", *options]

    def environment(self) -> Mapping[str, str]:
        return environment(self.var, **self.services)

    def ready(self) -> bool:
        # Where there is no broker it waits for one.
        return self.process.poll() is None

    def pool(self) -> list[int]:
        """The processes of its pool, in which tasks run."""
        return list(children(self.process.pid))
