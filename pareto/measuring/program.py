"""Measuring a configuration by running a program, which may fail, hang or print invalid output."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import tempfile
import threading
from collections.abc import Iterable, Mapping
from contextlib import suppress
from types import MappingProxyType
from typing import IO

from pareto.errors import EvaluationError, ObjectiveError, ScenarioError
from pareto.fronts.objective import Objective, read_values
from pareto.measuring.measurements import Feasible
from pareto.measuring.placeholders import CONFIG, Template
from pareto.measuring.table import require_feasible
from pareto.spaces.space import Configuration

MOST_OUTPUT = 1 << 20  # bytes at the end of the output that are searched for the answer
REMEDY = "end with an exit code other than 0 where a measurement fails"
NOTHING: Mapping[str, str] = MappingProxyType({})


class Program:
    """Runs a command for a configuration and reads its last line of output, a JSON object, for values.

    The command is split like a shell would, without a shell; `{config}` in an argument becomes the
    configuration as JSON, and `{name}` the value of that parameter or resource (see `Template`). An inactive
    parameter is null in JSON and the empty text elsewhere. Several threads may call one program at once.

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
    ) -> None:
        self.template = Template(command, [*parameters, *resources])
        self.objectives = objectives
        self.timeout = timeout
        self.feasible = feasible
        program = self.template.arguments[0]
        if "{" not in program and shutil.which(program) is None:
            raise ScenarioError(f"--command: there is no program {program!r}")
        self._lock = threading.Lock()
        self._running: set[subprocess.Popen[bytes]] = set()
        self._ended = False

    def __call__(
        self, configuration: Configuration, resources: Mapping[str, str] = NOTHING
    ) -> dict[str, float]:
        """Return the values of `configuration`; `resources` are in the program's environment, too.

        Raises EvaluationError with the reason when the program fails or prints no values, and when it takes
        longer than the timeout: then its process group ends: all its child processes, except those that left
        the group (setsid). Raises InfeasibleError, which is one, when the program's `feasible` (field, text
        when true) marks the configuration as infeasible.
        """
        values = {name: "" if value is None else str(value) for name, value in configuration.items()}
        code, output, complaints = self._run(
            self.template.fill({**values, **resources, CONFIG: json.dumps(configuration)}),
            {**os.environ, **resources},
        )
        if code != 0:
            last = (complaints.strip().splitlines() or ["nothing on its error output"])[-1]
            raise EvaluationError(f"{_describe(code)}: {last[:300]}")
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
        return dict(zip((item.name for item in self.objectives), read, strict=True))

    def end(self) -> None:
        """Kill every running program with its process group, and refuse new ones."""
        with self._lock:
            self._ended = True
            for program in self._running:
                if program.poll() is None:
                    _kill(program)

    def _run(self, arguments: list[str], environment: Mapping[str, str]) -> tuple[int, str, str]:
        """Return exit code, output and error output.

        Raises EvaluationError on a timeout, or if the program does not exist.
        """
        # Files, not pipes: a grandchild that keeps a pipe open would block until its end.
        with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as complaints:
            program = self._start(arguments, environment, output, complaints)
            try:
                code = program.wait(self.timeout)
            except subprocess.TimeoutExpired:
                raise EvaluationError(f"no answer after {self.timeout:g} s") from None
            finally:
                if program.poll() is None:  # a timeout, or the user's Ctrl-C
                    _kill(program)
                    program.wait()
                with self._lock:
                    self._running.discard(program)
            return code, _tail(output), _tail(complaints)

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


def _kill(program: subprocess.Popen[bytes]) -> None:
    """Kill the program's process group; on Windows only the program."""
    if hasattr(os, "killpg"):
        with suppress(ProcessLookupError):  # it has just ended by itself
            os.killpg(program.pid, signal.SIGKILL)
    else:
        program.kill()


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
