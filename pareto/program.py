"""Measuring a configuration by running a program, which may fail, hang or print nonsense."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Mapping
from typing import IO

from pareto.errors import EvaluationError, ObjectiveError, ScenarioError
from pareto.evaluation import Evaluate, require_feasible
from pareto.objective import Objective, read_values
from pareto.space import Configuration

MOST_OUTPUT = 1 << 20  # bytes at the end of the output in which the answer is looked for


def from_command(
    command: str,
    objectives: tuple[Objective, ...],
    timeout: float | None = None,
    feasible: tuple[str, str] | None = None,
) -> Evaluate:
    """Return a function that runs `command` and reads its last line of output, a JSON object, for values.

    The command is split like a shell would, without a shell; `{config}` in an argument becomes the
    configuration as JSON, even where a parameter has that name, and `{name}` the value of that parameter.
    The function raises EvaluationError with the reason when the program fails, prints no values, says with
    its `feasible` (field, text when true) that the configuration does not count, or takes longer than
    `timeout` seconds: then its whole process group ends, which is all that it has started but for what has
    left the group (setsid). Raises ScenarioError for a command that cannot be split or a program that is not
    there.
    """
    try:
        arguments = shlex.split(command)
    except ValueError as error:
        raise ScenarioError(f"--command {command!r}: {error}") from error
    if not arguments:
        raise ScenarioError("--command is empty")
    if "{" not in arguments[0] and shutil.which(arguments[0]) is None:
        raise ScenarioError(f"--command: there is no program {arguments[0]!r}")

    def evaluate(configuration: Configuration) -> dict[str, float]:
        fields = {
            **{name: str(value) for name, value in configuration.items()},
            "config": json.dumps(configuration),
        }
        code, output, complaints = _run([_fill(argument, fields) for argument in arguments], timeout)
        if code != 0:
            last = (complaints.strip().splitlines() or ["nothing on its error output"])[-1]
            raise EvaluationError(f"{_describe(code)}: {last[:300]}")
        last = (output.strip().splitlines() or [""])[-1]
        try:
            answer = json.loads(last)
        except (ValueError, RecursionError):
            raise EvaluationError(f"its last line is no JSON object: {last[:100]!r}") from None
        if feasible and isinstance(answer, Mapping):
            require_feasible(feasible, answer.get(feasible[0]))
        try:
            values = read_values(objectives, answer)
        except ObjectiveError as error:
            raise EvaluationError(f"its last line: {error}"[:400]) from error
        return dict(zip((item.name for item in objectives), values, strict=True))

    return evaluate


def _run(arguments: list[str], timeout: float | None) -> tuple[int, str, str]:
    """Return exit code, output and error output. Raises EvaluationError on a timeout or no such program."""
    # Files, not pipes: a grandchild that keeps a pipe open would keep us waiting for its end.
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as complaints:
        try:
            # A session, and with it a process group, of its own: what is in the group ends together.
            program = subprocess.Popen(
                arguments, stdin=subprocess.DEVNULL, stdout=output, stderr=complaints, start_new_session=True
            )
        except (OSError, ValueError) as error:
            raise EvaluationError(f"cannot run {arguments[0]}: {error}") from error
        try:
            code = program.wait(timeout)
        except subprocess.TimeoutExpired:
            raise EvaluationError(f"no answer after {timeout:g} s") from None
        finally:
            if program.poll() is None:  # a timeout, or the user's Ctrl-C
                _end(program)
        return code, _tail(output), _tail(complaints)


def _end(program: subprocess.Popen[bytes]) -> None:
    """Kill the program and what it has started in its process group; on Windows the program alone."""
    if hasattr(os, "killpg"):
        os.killpg(program.pid, signal.SIGKILL)
    else:
        program.kill()
    program.wait()


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


def _fill(argument: str, fields: dict[str, str]) -> str:
    # One pass from left to right: a value that itself contains braces must not be filled in again.
    parts, rest = [], argument
    while rest:
        at = {rest.find("{" + name + "}"): name for name in fields if "{" + name + "}" in rest}
        if not at:
            break
        start = min(at)
        parts += [rest[:start], fields[at[start]]]
        rest = rest[start + len(at[start]) + 2 :]
    return "".join([*parts, rest])
