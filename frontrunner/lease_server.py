"""Workers on several hosts measure for `frontrunner tune`, by the leases of the crowd's server.

The server runs in a folder of the search. Each measurement is an evaluation in its database, and stays
there: a result that arrives while the search is interrupted is used once it goes on. `evaluations.csv` is the
record. The server sends values of parameters, never a command: a worker has its own, whose digest must be the
search's.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import socket
import subprocess
import threading
import time
import urllib.request
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from groundwork import terminal
from pareto.errors import EvaluationError, InfeasibleError, ScenarioError
from pareto.fronts.censored import Censored
from pareto.measuring.folder import IMPORTED
from pareto.measuring.hosts import Hosting
from pareto.measuring.pool import Conditions, Resources
from pareto.search.explorer import Explorer
from pareto.spaces.space import Configuration
from slam.child_process import dies_with_parent

FOLDER, TOKEN, LOG = "workers", "token", "server.log"
PROGRAM = "program"  # the application of such evaluations
EVERY_ADDRESS = "0.0.0.0"  # of this machine
LEASE_SECONDS = 30  # without a heartbeat for so long, a worker counts as lost
NO_TIMEOUT = 7 * 24 * 3600  # seconds
POLL_SECONDS, REAP_SECONDS = 0.2, 5.0
PORT_SECONDS, START_SECONDS, STOP_SECONDS = 10.0, 300.0, 10.0


def device_name(command: str) -> str:
    """Return the name under which workers with this `command` measure."""
    return f"{PROGRAM}-{hashlib.sha256(command.encode()).hexdigest()[:16]}"


@contextmanager
def hosted(hosting: Hosting) -> Iterator[HostedProgram]:
    """Serve workers; yield what measures by them. Raises ScenarioError where the server cannot start."""
    data = hosting.folder / FOLDER
    data.mkdir(parents=True, exist_ok=True, mode=0o700)
    os.environ |= {
        "DJANGO_SETTINGS_MODULE": "frontrunner.lease_settings",
        "FRONTRUNNER_VAR": str(data.absolute()),
        "FRONTRUNNER_LEASE_SECONDS": os.environ.get("FRONTRUNNER_LEASE_SECONDS", str(LEASE_SECONDS)),
        "FRONTRUNNER_MEASUREMENT_TIMEOUT_SECONDS": str(max(1, round(hosting.timeout or NO_TIMEOUT))),
    }
    try:
        import django
    except ModuleNotFoundError as missing:
        raise ScenarioError("--serve-workers needs a server: pip install 'frontrunner[server]'") from missing
    django.setup()
    from crowd.database.upgrade import migrate
    from crowd.explorations.measuring.leases import renew_all

    migrate()
    program = HostedProgram(hosting)
    renew_all()
    _wait_for_port(hosting.host, hosting.port)
    server = _start(hosting, data / LOG)
    try:
        _wait_until_it_answers(hosting, server, data / LOG)
        token = _token(program.device, data / TOKEN)
        host = socket.gethostname() if hosting.host == EVERY_ADDRESS else hosting.host
        url = f"http://{host}:{hosting.port}"
        terminal.note(f"workers measure at {url}; the token is {token}, also in {data / TOKEN}")
        terminal.note(f"on each host: frontrunner worker {url} --token-file FILE --command '...'")
        program.server = server
        yield program
    finally:
        program.end()
        _stop(server)


class HostedProgram:
    """Measures a configuration by whichever worker leases it first. Several threads may call it at once."""

    def __init__(self, hosting: Hosting) -> None:
        from crowd.explorations.models import Exploration, ReferenceDevice

        name = device_name(hosting.command)
        self.device, _ = ReferenceDevice.objects.update_or_create(
            name=name, defaults={"queue": name, "machines": hosting.jobs}
        )
        explorer, feasible = hosting.explorer, hosting.feasible
        maximised = [objective.name for objective in explorer.objectives if objective.maximise]
        self._objectives = [objective.name for objective in explorer.objectives]
        self._feasible = feasible
        self._exploration, _ = Exploration.objects.update_or_create(
            reference_device=self.device,
            defaults={
                "application": PROGRAM,
                "space": explorer.space.to_dict(),
                "objectives": self._objectives,
                "options": {
                    "feasible": feasible,
                    "maximised": maximised,
                    "grace_seconds": hosting.grace,
                },
                "budget": 1,
            },
        )
        self._started = recorded(explorer)
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._reaped = time.monotonic()
        self.server: subprocess.Popen[bytes] | None = None

    def __call__(
        self, configuration: Configuration, _resources: Resources, conditions: Conditions
    ) -> dict[str, float]:
        """Return the values of `configuration`, those that are bounds Censored.

        Raises EvaluationError as the worker's `Program` does.
        """
        from django.db import connection

        try:
            return self._wait_for(self._evaluation(configuration, conditions))
        finally:
            connection.close()  # that of this thread

    def end(self) -> None:
        """Wait for no more results; workers may still deliver them to a later server."""
        self._ended.set()

    def _evaluation(self, configuration: Configuration, conditions: Conditions) -> int:
        """Return the key of the next evaluation of `configuration`: one of an earlier call, or a new one.

        One of an earlier call keeps the conditions of then: what broke them is bad now, too.
        """
        from crowd.explorations.models import Evaluation

        key = _digest(configuration)
        with self._lock:
            stored = Evaluation.objects.filter(exploration=self._exploration)
            earlier = stored.filter(configuration_key=key).order_by("number")[self._started[key] :].first()
            self._started[key] += 1
            if earlier is not None:
                return int(earlier.pk)
            return int(
                Evaluation.objects.create(
                    exploration=self._exploration,
                    number=stored.count(),
                    phase=Evaluation.Phase.GIVEN,
                    configuration=configuration,
                    configuration_key=key,
                    stop_above=[dict(condition) for condition in conditions],
                ).pk
            )

    def _wait_for(self, evaluation: int) -> dict[str, float]:
        from crowd.explorations.models import Evaluation

        while True:
            row = Evaluation.objects.only("state", "objectives", "censored", "error").get(pk=evaluation)
            if row.state == Evaluation.State.DONE and row.objectives is not None:
                values = {name: float(row.objectives[name]) for name in self._objectives}
                return values | {name: Censored(values[name]) for name in row.censored}
            if row.state == Evaluation.State.FAILED:
                marked = self._feasible and row.error.startswith(f"{self._feasible[0]} is ")
                raise (InfeasibleError if marked else EvaluationError)(row.error)
            if self._ended.wait(POLL_SECONDS):
                raise EvaluationError("the search has ended")
            if self.server is not None and self.server.poll() is not None:
                raise ScenarioError(f"the server for workers ended with exit code {self.server.returncode}")
            self._reap()

    def _reap(self) -> None:
        from crowd.explorations.measuring import reaping

        with self._lock:
            due = time.monotonic() >= self._reaped + REAP_SECONDS
            self._reaped = time.monotonic() if due else self._reaped
        if due:
            reaping.reap()


def recorded(explorer: Explorer) -> Counter[str]:
    """Return how often each configuration was measured here, by its digest."""
    history = explorer.history
    return Counter(
        {
            _digest(explorer.space.decode(index)): len(values)
            for index, values in history.results.items()
            if history.phases[index] != IMPORTED
        }
    )


def _digest(configuration: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(configuration, sort_keys=True).encode()).hexdigest()


def _token(device: Any, path: Path) -> str:
    """Return the token of `device`, the earlier one if it is valid: workers outlive the search."""
    from crowd.explorations.measuring.tokens import device_of_token, issue_token

    with suppress(FileNotFoundError):
        token = path.read_text().strip()
        if device_of_token(token) == device:
            return token
    token = issue_token(device)
    path.touch(mode=0o600)
    path.write_text(f"{token}\n")
    return token


def _wait_for_port(host: str, port: int) -> None:
    """Return when the port is free: the server of a search that was just killed needs a moment to end."""
    limit = time.monotonic() + PORT_SECONDS
    while True:
        try:
            socket.create_server((host, port)).close()
            return
        except OSError as error:
            if time.monotonic() > limit:
                raise ScenarioError(
                    f"--serve-workers: port {port} of {host} cannot be used: {error.strerror}"
                ) from error
        time.sleep(POLL_SECONDS)


def _start(hosting: Hosting, log: Path) -> subprocess.Popen[bytes]:
    from crowd.operations import web_server

    with log.open("ab") as output:
        return subprocess.Popen(
            web_server.command(hosting.host, hosting.port, "--workers", "1"),
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            preexec_fn=dies_with_parent(signal.SIGTERM),
        )


def _stop(server: subprocess.Popen[bytes]) -> None:
    server.terminate()
    try:
        server.wait(STOP_SECONDS)
    except subprocess.TimeoutExpired:  # a server that is just starting misses the signal
        os.killpg(server.pid, signal.SIGKILL)
        server.wait()


def _wait_until_it_answers(hosting: Hosting, server: subprocess.Popen[bytes], log: Path) -> None:
    host = "127.0.0.1" if hosting.host == EVERY_ADDRESS else hosting.host
    limit = time.monotonic() + START_SECONDS
    while server.poll() is None and time.monotonic() < limit:
        with suppress(OSError), urllib.request.urlopen(f"http://{host}:{hosting.port}/healthz", timeout=5):
            return
        time.sleep(POLL_SECONDS)
    raise ScenarioError(f"--serve-workers: no server at {hosting.host}:{hosting.port}; see {log}")
