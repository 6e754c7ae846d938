"""Everything that serves explorations on one machine, and ways to kill each part of it."""

import os
import random
import signal
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

from tests.services import exploring, notes
from tests.services.program import Program
from tests.services.serving import Services, Serving
from tests.services.worker import Worker
from tests.waiting import until


class Installation:
    """Web server with its own workers, `workers` of one device, broker and database; in a with statement.

    Without `broker` and `database`, which run already, it is the embedded default. `options` are the
    workers', `more` is environment: its DATABASE_URL is a database of `database`.
    """

    def __init__(
        self,
        var: Path,
        broker: Program | None,
        database: Program | None,
        workers: int,
        options: Sequence[str] = (),
        **more: str,
    ) -> None:
        self.var, self.broker, self.database = var, broker, database
        self.services: Services = dict(exploring.SETTINGS)
        if broker is not None:
            self.services["CELERY_BROKER_URL"] = broker.url
        if database is not None:
            self.services["DATABASE_URL"] = database.url
        self.services |= more
        self.server = Serving(var, self.services)
        self.workers = [
            Worker(var, self.services, exploring.DEVICE, number, options) for number in range(workers)
        ]

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.enter_context(self.server)
            for worker in self.workers:
                stack.enter_context(worker)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *exception: Any) -> None:
        self._stack.__exit__(*exception)

    def state(self) -> str:
        """The newest exploration's state from the web server; empty while it does not answer."""
        try:
            _, answer = self.server.call("GET", "/api/v1/explorations")
            return str(answer["results"][0]["state"])
        except (OSError, ValueError, KeyError):
            return ""

    def kills(self, chance: random.Random) -> list[Callable[[], None]]:
        """Every kind of kill, in a random order; each starts again what does not restart by itself."""
        every_kill = [
            lambda: self.kill_worker(chance.choice(self.workers)),
            lambda: self.kill_measuring_worker(chance.choice(self.workers)),
            lambda: self.kill_measuring_process(chance.choice(self.workers)),
            lambda: self.server.kill_child("--beat"),
            lambda: self.server.kill_child("granian"),
            self.lose_the_messages,
            self.kill_everything,
        ]
        if self.database is not None:
            every_kill.append(self.kill_the_database)
        chance.shuffle(every_kill)
        return every_kill

    def kill_worker(self, worker: Worker) -> None:
        """The worker alone: what it started must end by itself."""
        os.kill(worker.process.pid, signal.SIGKILL)
        worker.process.wait()
        worker.start()

    def kill_measuring_worker(self, worker: Worker) -> None:
        """The worker alone, in the middle of a measurement."""
        until(lambda: self._stopped_while_measuring(worker))
        self.kill_worker(worker)

    def kill_measuring_process(self, worker: Worker) -> None:
        """The process of the worker's pool, in the middle of a measurement; the worker survives that."""
        os.kill(until(lambda: self._stopped_while_measuring(worker)), signal.SIGKILL)

    def _stopped_while_measuring(self, worker: Worker) -> int | None:
        """The process of `worker`'s pool if it measures, and halted; None, and running, if it does not."""
        for pid in worker.pool():
            os.kill(pid, signal.SIGSTOP)
            notes_of_process = [note for note in notes.read(self.var) if note.pid == pid]
            if notes_of_process and notes_of_process[-1].what == "begun":
                return pid
            os.kill(pid, signal.SIGCONT)
        return None

    def lose_the_messages(self) -> None:
        """kill -9 of the broker; the embedded one has no process, and loses all its files instead."""
        if self.broker is not None:
            self.broker.kill()
            self.broker.start()
            return
        for message in (self.var / "broker" / "queue").iterdir():
            message.unlink(missing_ok=True)

    def kill_the_database(self) -> None:
        """kill -9 of the database's server and all its processes."""
        assert self.database is not None
        self.database.kill()
        self.database.start()

    def kill_everything(self) -> None:
        """As if the machine lost its power."""
        programs = [program for program in (self.database, self.broker) if program is not None]
        programs += [self.server, *self.workers]
        for program in programs:
            program.kill()
        for program in programs:
            program.start()
