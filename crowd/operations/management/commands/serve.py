"""manage.py serve [--measure | --demo]: web server and workers on one machine, in one process tree."""

import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

from django.conf import settings
from django.core.management.base import BaseCommand, CommandError, CommandParser
from django.db import connections

from crowd.devices.models import Installation
from crowd.explorations.measuring.reference_devices import THIS_MACHINE
from crowd.observability.environment import DataFolderError
from crowd.operations import first_run, web_server
from crowd.operations.supervision import Child, Supervisor, exclusive_lock
from crowd.results.models import MeasurementSession
from crowd.results.privacy.own_page import own_page_path
from crowd.results.reading import selectors
from crowd.simulation import options as demo_options
from crowd.simulation.transport import RefusedError

START_TIMEOUT_SECONDS = 60.0
SUMMARY_TIMEOUT_SECONDS = 60.0


class Stopped(BaseException):
    """Ctrl-C or SIGTERM."""


class Command(BaseCommand):
    help = "Run web server and worker on this machine until Ctrl-C."

    def add_arguments(self, parser: CommandParser) -> None:
        parser.add_argument(
            "--measure", action="store_true", help="measure this machine once with the client"
        )
        parser.add_argument("--port", type=int, default=settings.FRONTRUNNER_PORT)
        demo_options.add_arguments(parser)

    def handle(self, *args: Any, measure: bool, port: int, **options: Any) -> None:  # noqa: ARG002
        self.host, self.port, self.options = settings.FRONTRUNNER_BIND, port, options
        demo_options.check_arguments(options["devices"], options["seed"])
        if measure and options["demo"]:
            raise CommandError("--measure and --demo: a demo server takes no measurements")
        self._refuse_taken_port()
        try:
            with exclusive_lock(Path(settings.FRONTRUNNER_VAR)):
                self._serve(measure)
        except (DataFolderError, first_run.RealServerError, RefusedError) as error:
            raise CommandError(str(error)) from error

    def _serve(self, measure: bool) -> None:
        signal.signal(signal.SIGINT, _stop)
        signal.signal(signal.SIGTERM, _stop)
        supervisor = Supervisor(self._children(), self._say)
        try:
            self._prepare()
            supervisor.start()
            self._wait_until_it_answers(supervisor)
            if measure:
                self._measure(supervisor)
            # Started last, so that measurements of explorations do not disturb the session above.
            supervisor.add(self._worker(THIS_MACHINE))
            self._say(f"Dashboard: {self._site()}   API: {self._site()}api/v1/docs   (Ctrl-C ends)")
            supervisor.wait(lambda: False)
        except Stopped:
            # A second Ctrl-C must not leave children behind.
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
            self._say("Ending.")
        finally:
            supervisor.stop()

    def _address(self) -> str:
        host = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(self.host, self.host)
        return f"http://{host}:{self.port}/"

    def _site(self) -> str:
        """The address that people open: behind a proxy it is not the one where this program listens."""
        proxied = settings.HTTPS and settings.PUBLIC_HOSTS
        return f"https://{settings.PUBLIC_HOSTS[0]}/" if proxied else self._address()

    def _say(self, line: str) -> None:
        self.stdout.write(line)
        self.stdout.flush()

    def _refuse_taken_port(self) -> None:
        family = socket.AF_INET6 if ":" in self.host else socket.AF_INET
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((self.host, self.port))
            except (OSError, OverflowError) as error:
                raise CommandError(
                    f"port {self.port} on {self.host} cannot be used ({getattr(error, 'strerror', error)}): "
                    f"choose another, such as make run PORT={self.port % 60000 + 1}"
                ) from error

    def _children(self) -> list[Child]:
        web = web_server.command(self.host, self.port, "--workers", "1", "--workers-kill-timeout", "5")
        schedule = str(Path(settings.FRONTRUNNER_VAR) / "beat")
        return [
            self._child("web server", "web.log", web),
            self._worker(settings.CELERY_TASK_DEFAULT_QUEUE, "--beat", "--schedule", schedule),
        ]

    def _worker(self, queue: str, *more: str) -> Child:
        """A Celery worker that runs one task at a time."""
        command = [
            *(sys.executable, "-m", "celery", "--app", "crowd", "worker", "--pool", "solo"),
            *("--queues", queue, "--hostname", f"{queue}@%h", *more),
            *("--without-gossip", "--without-mingle", "--without-heartbeat", "--loglevel", "INFO"),
        ]
        if queue == settings.CELERY_TASK_DEFAULT_QUEUE:
            return self._child("worker", "worker.log", command)
        return self._child(f"worker of {queue}", f"worker-{queue}.log", command)

    def _child(self, name: str, log: str, command: list[str]) -> Child:
        var = Path(settings.FRONTRUNNER_VAR)
        environment = os.environ | {"FRONTRUNNER_VAR": str(var)}
        return Child(name, command, var / "logs" / log, environment, settings.BASE_DIR)

    def _prepare(self) -> None:
        first_run.prepare(self._say, self._site(), self.options["demo"])
        if self.options["demo"]:
            from crowd.simulation import filling

            filling.fill(self.options["devices"], self.options["seed"], self._say)
        # The children open their own connections; one kept here would outlive a restart of the database.
        connections.close_all()

    def _wait_until_it_answers(self, supervisor: Supervisor) -> None:
        web = supervisor.children[0]
        self._say(f"Logs: {web.log.parent}")
        limit = time.monotonic() + START_TIMEOUT_SECONDS
        while not self._answers():
            ended = web.exit_reason()
            if ended is not None or time.monotonic() > limit:
                lines = web.log.read_text(errors="replace").strip().splitlines()
                last = lines[-1] if lines else "no output"
                raise CommandError(f"the web server {ended or 'does not answer'}: {last} (log: {web.log})")
            time.sleep(0.05)

    def _answers(self) -> bool:
        try:
            with urllib.request.urlopen(f"{self._address()}healthz", timeout=2) as response:
                return bool(response.status == 200)
        except (urllib.error.URLError, OSError):
            return False

    def _measure(self, supervisor: Supervisor) -> None:
        """Run a client session on this machine, and print its figures."""
        newest = MeasurementSession.objects.order_by("-pk").values_list("pk", flat=True).first() or 0
        connections.close_all()
        environment = {"FRONTRUNNER_HOME": str(Path(settings.FRONTRUNNER_VAR) / "client")} | dict(os.environ)
        client = subprocess.Popen(
            [sys.executable, "-m", "client_kit", "run", "--server", self._address().rstrip("/"), "--yes"],
            env=environment,
            cwd=settings.BASE_DIR,
        )
        try:
            supervisor.wait(lambda: client.poll() is not None)
        finally:
            if client.poll() is None:
                client.terminate()
                client.wait()
        if client.returncode:
            self._say(f"The client ended with code {client.returncode}; the server continues.")
        supervisor.wait(lambda: self._summarised(newest), SUMMARY_TIMEOUT_SECONDS)
        for line in self._speedups(newest):
            self._say(line)

    def _summarised(self, newest: int) -> bool:
        """Whether all sessions after `newest` are summarised; true without one."""
        try:
            return not MeasurementSession.objects.filter(pk__gt=newest, summary_algorithm=None).exists()
        finally:
            connections.close_all()

    def _speedups(self, newest: int) -> list[str]:
        arrived = MeasurementSession.objects.filter(pk__gt=newest).count()
        rows = selectors.latest_sessions(arrived)
        installation = Installation.objects.filter(sessions__pk__gt=newest).first()
        connections.close_all()
        if not rows or installation is None:
            return ["No session arrived: the lines above say why."]
        lines = []
        for row in reversed(rows):
            for answer in row.speedups:
                note = f" ({answer.state}: {answer.reason})" if answer.reason else ""
                value = "none" if answer.speedup is None else f"{answer.speedup:.2f}"
                if answer.range:
                    value = f"between {answer.range[0]:.2f} and {answer.range[1]:.2f}"
                lines.append(
                    f"Speedup of {answer.configuration} over {answer.baseline} on this device: {value}{note}"
                )
            lines.append(f"Device page: {self._address()}devices/{row.device.slug}/")
            if row.device.masked:
                lines.append("  (this model is shown by its chip: too few installations measured it, or its")
                lines.append("  name is not known to this server)")
        lines.append(f"Your own page: {self._address().rstrip('/')}{own_page_path(installation)}")
        return lines


def _stop(*_: Any) -> None:
    raise Stopped
