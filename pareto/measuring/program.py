"""Measuring a configuration by running a program, which may fail, hang or print invalid output."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import IO

from pareto.errors import EvaluationError, ObjectiveError, ScenarioError
from pareto.fronts.objective import Objective, read_values
from pareto.measuring.measurements import Feasible, number
from pareto.measuring.placeholders import CONFIG, Template
from pareto.measuring.pool import Conditions
from pareto.measuring.table import require_feasible
from pareto.search.stopping import Stop, find_stop
from pareto.spaces.space import Configuration

MOST_OUTPUT = 1 << 20  # bytes at the end of the output that are searched for the answer
GRACE = 5.0  # seconds
POLL = 0.1  # seconds between two looks for what a program reports
REPORT = re.compile(r"report((?:\s+[^\s=~]+[=~]\S+)+)\s*")
REPORTED = re.compile(r"([^\s=~]+)([=~])(\S+)")
REMEDY = "end with an exit code other than 0 where a measurement fails"
NOTHING: Mapping[str, str] = MappingProxyType({})


@dataclass(frozen=True)
class Outcome:
    """The `values` of a configuration; where a condition ended its program, after how many reports."""

    values: dict[str, float]
    stopped_at: int | None = None


class Program:
    """Runs a command for a configuration and reads its last line of output, a JSON object, for values.

    The command is split like a shell would, without a shell; `{config}` in an argument becomes the
    configuration as JSON, and `{name}` the value of that parameter or resource (see `Template`). An inactive
    parameter is null in JSON and the empty text elsewhere. Several threads may call one program at once.

    A line `report error=.03 seconds~.8` on its output is an intermediate value: the error will be .03 or
    worse, and the seconds about .8. See `pareto.search.stopping` for when it ends the program.

    Raises ScenarioError for a command that cannot be read, or a program that does not exist.
    """

    def __init__(
        self,
        command: str,
        parameters: Iterable[str],
        objectives: tuple[Objective, ...],
        timeout: float | None = None,
        feasible: Feasible | None = None,
        resources: Iterable[str] = (),
        grace: float = GRACE,
    ) -> None:
        self.template = Template(command, [*parameters, *resources])
        self.objectives = objectives
        self.timeout = timeout
        self.feasible = feasible
        self.grace = grace
        program = self.template.arguments[0]
        if "{" not in program and shutil.which(program) is None:
            raise ScenarioError(f"--command: there is no program {program!r}")
        self._lock = threading.Lock()
        self._running: set[subprocess.Popen[bytes]] = set()
        self._ended = False

    def __call__(
        self,
        configuration: Configuration,
        resources: Mapping[str, str] = NOTHING,
        conditions: Conditions = (),
    ) -> dict[str, float]:
        """Return the values of `configuration`, otherwise as `measure`."""
        return self.measure(configuration, resources, conditions).values

    def measure(
        self,
        configuration: Configuration,
        resources: Mapping[str, str] = NOTHING,
        conditions: Conditions = (),
    ) -> Outcome:
        """Return the outcome of `configuration`; `resources` are in the program's environment, too.

        One of `conditions` ends the program; its values are then the reported ones, bounds among them
        Censored.

        Raises EvaluationError with the reason when the program fails or prints no values, and when it takes
        longer than the timeout. It ends with its process group: all its child processes, except those that
        left the group (setsid). Raises InfeasibleError, which is one, when the program's `feasible` (field,
        text when true) marks the configuration as infeasible.
        """
        values = {name: "" if value is None else str(value) for name, value in configuration.items()}
        arguments = self.template.fill({**values, **resources, CONFIG: json.dumps(configuration)})
        reports = _Reports([objective.name for objective in self.objectives])
        end, output, complaints = self._run(arguments, {**os.environ, **resources}, conditions, reports)
        if isinstance(end, Stop):
            if end.values is None:
                raise EvaluationError(f"{end.reason}; not all objectives were reported")
            return Outcome(end.values, reports.count)
        if end != 0:
            last = (complaints.strip().splitlines() or ["nothing on its error output"])[-1]
            raise EvaluationError(f"{_describe(end)}: {last[:300]}")
        last = (output.strip().splitlines() or [""])[-1]
        try:
            answer = json.loads(last)
        except (ValueError, RecursionError):
            answer = None
        if not isinstance(answer, Mapping):
            raise EvaluationError(f"its last line is not a JSON object: {last[:100]!r}")
        if self.feasible:
            require_feasible(self.feasible, answer.get(self.feasible[0]))
        try:
            read = read_values(self.objectives, answer, REMEDY)
        except ObjectiveError as error:
            raise EvaluationError(f"its last line: {error}"[:400]) from error
        return Outcome(dict(zip((item.name for item in self.objectives), read, strict=True)))

    def end(self) -> None:
        """End every running program with its process group, and refuse new ones."""
        with self._lock:
            self._ended = True
            running = [program for program in self._running if program.poll() is None]
        _end(running, self.grace)

    def _run(
        self,
        arguments: list[str],
        environment: Mapping[str, str],
        conditions: Conditions,
        reports: _Reports,
    ) -> tuple[int | Stop, str, str]:
        """Return exit code, or why one of the `conditions` ended the program, output and error output.

        Raises EvaluationError on a timeout, or if the program does not exist.
        """
        # Files, not pipes: a grandchild that keeps a pipe open would block until its end.
        with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as complaints:
            program = self._start(arguments, environment, output, complaints)
            try:
                end = self._wait(program, output, conditions, reports)
            finally:
                if program.poll() is None:  # a timeout, a condition, or the user's Ctrl-C
                    _end([program], self.grace)
                    program.wait()
                with self._lock:
                    self._running.discard(program)
            return end, _tail(output), _tail(complaints)

    def _wait(
        self,
        program: subprocess.Popen[bytes],
        output: IO[bytes],
        conditions: Conditions,
        reports: _Reports,
    ) -> int | Stop:
        """Return the exit code, or why the program has to end. Raises EvaluationError on a timeout."""
        deadline = time.monotonic() + (math.inf if self.timeout is None else self.timeout)
        while (left := deadline - time.monotonic()) > 0:
            wait = min(left, POLL) if conditions and hasattr(os, "pread") else left  # Windows has none
            try:
                return program.wait(None if wait == math.inf else wait)
            except subprocess.TimeoutExpired:
                if reports.read(output.fileno()):
                    stop = find_stop(self.objectives, conditions, reports.bounds, reports.estimates)
                    if stop:
                        return stop
        raise EvaluationError(f"no answer after {self.timeout:g} s")

    def _start(
        self, arguments: list[str], environment: Mapping[str, str], output: IO[bytes], complaints: IO[bytes]
    ) -> subprocess.Popen[bytes]:
        with self._lock:
            if self._ended:
                raise EvaluationError("the search has ended")
            try:
                # Its own session and process group, so that the whole group can be ended.
                program = subprocess.Popen(
                    arguments,
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=complaints,
                    env=environment,
                    start_new_session=True,
                )
            except (OSError, ValueError) as error:
                raise EvaluationError(f"cannot run {arguments[0]}: {error}") from error
            self._running.add(program)
            return program


class _Reports:
    """Reads what a program reports of the objectives `names` while it writes; `count` lines so far."""

    def __init__(self, names: Collection[str]) -> None:
        self.count = 0
        self.bounds: dict[str, float] = {}
        self.estimates: dict[str, float] = {}
        self._names, self._position = names, 0

    def read(self, output: int) -> bool:
        """Take the latest values from new whole lines of the file `output`; return whether there are any."""
        new = os.pread(output, MOST_OUTPUT, self._position)
        whole = new[: new.rfind(b"\n") + 1] or (new if len(new) == MOST_OUTPUT else b"")
        self._position += len(whole)
        lines = [_reported(line) for line in whole.decode(errors="replace").splitlines()]
        self.count += sum(map(bool, lines))
        items = [item for line in lines for item in line]
        for name, kind, value in items:
            if name in self._names:
                (self.bounds if kind == "=" else self.estimates)[name] = value
        return bool(items)


def _reported(line: str) -> list[tuple[str, str, float]]:
    """Return names, = or ~, and the finite values of a line that reports any."""
    if not (match := REPORT.fullmatch(line)):
        return []
    items = [(name, kind, number(value)) for name, kind, value in REPORTED.findall(match[1])]
    return [item for item in items if not math.isnan(item[2])]


def _end(programs: Collection[subprocess.Popen[bytes]], grace: float) -> None:
    """Send SIGTERM to the programs' process groups, and SIGKILL to what is left after `grace` seconds.

    Windows has no groups: only the programs end there.
    """
    if not hasattr(os, "killpg"):
        for program in programs:
            program.kill()
        return
    left = [program for program in programs if _signal(program, signal.SIGTERM)]
    deadline = time.monotonic() + grace
    while left and time.monotonic() < deadline:
        time.sleep(min(POLL, grace))
        left = [program for program in left if program.poll() is None or _signal(program, 0)]
    for program in left:
        _signal(program, signal.SIGKILL)


def _signal(program: subprocess.Popen[bytes], number: int) -> bool:
    """Send a signal to the program's group; return whether there was anybody to receive it."""
    try:
        os.killpg(program.pid, number)
    except ProcessLookupError:
        return False
    return True


def _tail(file: IO[bytes]) -> str:
    size = file.seek(0, os.SEEK_END)
    file.seek(max(0, size - MOST_OUTPUT))
    return file.read().decode(errors="replace")


def _describe(code: int) -> str:
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"ended by {signal.Signals(-code).name}"
    except ValueError:
        return f"ended by signal {-code}"
