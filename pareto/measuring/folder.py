"""An exploration on disk: every measurement appended as it arrives, and a state to resume from."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pareto.errors import DamagedStateError, ObjectiveError, StateError
from pareto.fronts.censored import CENSORED, censored_names, mark_censored
from pareto.numbers import as_printed
from pareto.search.explorer import Explorer
from pareto.search.frames import columns
from pareto.search.recommendation import is_noisy
from pareto.spaces.space import Configuration, Space

EVALUATIONS, FRONT, PAGE, STATE, SPACE, SOURCE, PLAN, LOCK = (
    "evaluations.csv",
    "front.csv",
    "front.html",
    "state.json",
    "space.json",
    "source.json",
    "plan.json",
    ".lock",
)
DAMAGED = "state.damaged.json"  # the copy of a state that could not be read
IMPORTED = "told"  # the phase of measurements of an earlier run


class Folder:
    """Keeps `evaluations.csv`, `front.csv` and the state, space and source (JSON) of one exploration.

    The state is replaced after every `ask`; measurements go to the CSV file only. After a crash, the state
    and the later rows restore the explorer exactly. Without a readable state, the rows alone restore all
    measurements.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._written: int | None = None  # rows in evaluations.csv, None before they were counted

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Lock the folder against other processes; the lock ends with the process.

        Raises StateError when another process holds it.
        """
        self.path.mkdir(parents=True, exist_ok=True)
        with (self.path / LOCK).open("a") as file:
            _lock(file.fileno(), self.path)
            yield

    def space(self) -> Space:
        """Return the space of this exploration. Raises StateError where there is none."""
        if not (self.path / SPACE).exists():
            raise StateError(f"{self.path} holds no exploration: there is no {SPACE}")
        return Space.load(self.path / SPACE)

    def resume(self, space: Space) -> Explorer | None:
        """Return the explorer of this folder, ready to go on, or None when there was none.

        Raises StateError when the folder holds another space's exploration or a damaged file.
        """
        explorer = self.read(space)
        if explorer is not None:
            self._cut_torn_row()
        return explorer

    def rebuild(self, fresh: Explorer, reason: str) -> Explorer:
        """Tell `fresh` every row of `evaluations.csv`; keep a damaged state under DAMAGED.

        `reason` says why the state cannot be used. The explorer goes on with the same measurements; its next
        proposals may differ. Raises StateError when the rows are not of these parameters and objectives.
        """
        try:
            measurements = self.measurements(fresh)
        except StateError as error:
            raise StateError(f"{reason}, and {error}") from error
        for configuration, values, phase in measurements:
            fresh.tell([configuration], [values], phase=phase)
        fresh.skip_asks(len(measurements) + 1)
        if (self.path / STATE).exists():
            (self.path / STATE).replace(self.path / DAMAGED)
        self.asked(fresh)
        return fresh

    def measurements(self, explorer: Explorer) -> list[tuple[Configuration, dict[str, float] | None, str]]:
        """Return configuration, values (None for a failure) and phase of every row of `evaluations.csv`.

        A torn last row is cut off. Raises StateError when the rows are not of the explorer's parameters and
        objectives.
        """
        path = self.path / EVALUATIONS
        rows = _whole_rows(path)[0] if path.exists() else []
        if rows and rows[0] != header(explorer):
            raise StateError(
                f"{path} has the columns {', '.join(rows[0])} instead of {', '.join(header(explorer))}: give "
                "the space and objectives that were measured here"
            )
        measurements = [(*self._read(explorer.space, explorer, row), row[1]) for row in rows[1:]]
        self._cut_torn_row()
        return measurements

    def _cut_torn_row(self) -> None:
        """Cut off a row half written in a crash, which would run into the next one; it is measured again."""
        path = self.path / EVALUATIONS
        if path.exists():
            _, length = _whole_rows(path)
            with path.open("r+b") as file:
                file.truncate(length)
        self._written = None

    def read(self, space: Space) -> Explorer | None:
        """Return the explorer as `resume` does, without writing: another process may be exploring.

        Raises DamagedStateError, which is a StateError, where `rebuild` can help.
        """
        try:
            text = (self.path / STATE).read_text(encoding="utf-8")
        except FileNotFoundError:
            if not self.rows():
                return None
            raise DamagedStateError(
                f"{self.path / STATE} is missing beside {EVALUATIONS}: the explore command that measured "
                "here rebuilds it"
            ) from None
        except UnicodeDecodeError as error:
            raise self._damaged(error) from error
        # The rows are read after the state: a running exploration writes rows first.
        rows = self.rows()
        try:
            explorer = Explorer.restore(space, json.loads(text))
        except DamagedStateError as error:
            raise self._damaged(error) from error
        except StateError:
            raise
        except (ValueError, RecursionError) as error:
            raise self._damaged(error) from error
        stored = explorer.history.measurements
        if len(rows) < stored:
            raise StateError(
                f"rows are lost: {self.path / EVALUATIONS} has {len(rows)} of the {stored} that {STATE} knows"
            )
        for row in rows[stored:]:
            configuration, values = self._read(space, explorer, row)
            explorer.tell([configuration], [values], phase=row[1])
        return explorer

    def require_source(self, kind: str, value: str) -> None:
        """Record the source of measurements: a command, or the digest of a table.

        Raises StateError when `evaluations.csv` has another source.
        """
        path, source = self.path / SOURCE, {kind: value}
        if not path.exists() or not self.rows():
            self._replace(SOURCE, json.dumps(source) + "\n")
            return
        try:
            before = json.loads(path.read_text(encoding="utf-8"))
        except ValueError as error:
            raise StateError(f"{path} is damaged: {error}") from error
        if before != source:
            raise StateError(
                f"{self.path} was measured by {json.dumps(before)}, not by {json.dumps(source)}: use another "
                f"--out, or, if both measure the same, delete {path}"
            )

    def record_budget(self, budget: int) -> None:
        """Record how many measurements are planned, for pages over many folders."""
        self._replace(PLAN, json.dumps({"budget": budget}) + "\n")

    def budget(self) -> int | None:
        """Return the number of planned measurements, None where it is not known."""
        try:
            return int(json.loads((self.path / PLAN).read_text(encoding="utf-8"))["budget"])
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def asked(self, explorer: Explorer) -> None:
        """Save the state before a batch is measured, so that the batch can be finished after a crash."""
        self.path.mkdir(parents=True, exist_ok=True)
        if not (self.path / SPACE).exists():
            self._replace(SPACE, json.dumps(explorer.space.to_dict(), indent=2) + "\n")
        self._replace(STATE, json.dumps(explorer.state()) + "\n")

    def append(
        self,
        explorer: Explorer,
        configuration: Configuration,
        values: dict[str, float] | None,
        seconds: float | None = None,
        error: str = "",
    ) -> None:
        """Append the last measurement to `evaluations.csv` and sync it to disk."""
        path = self.path / EVALUATIONS
        fresh = not path.exists() or path.stat().st_size == 0
        self.path.mkdir(parents=True, exist_ok=True)
        names = [objective.name for objective in explorer.objectives]
        index = explorer.space.encode(configuration)
        phase, point = explorer.history.phases[index], explorer.space.decode(index)
        number = (len(self.rows()) if self._written is None else self._written) + 1
        with path.open("a", newline="", encoding="utf-8") as file:
            if fresh:
                file.write(_line(header(explorer)))
            measured = ["" if values is None else _number(values[name]) for name in names]
            taken = "" if seconds is None else f"{seconds:.3f}"
            reason = " ".join(error.split())
            row = [number, phase, *point.values(), *measured, taken, reason, censored_names(values)]
            file.write(_line(row))
            file.flush()
            os.fsync(file.fileno())
        self._written = number

    def rows(self) -> list[list[str]]:
        """Return the rows of `evaluations.csv` below its header; there may be none yet."""
        path = self.path / EVALUATIONS
        return _whole_rows(path)[0][1:] if path.exists() else []

    def write_front(self, explorer: Explorer) -> None:
        """Write the recommended front to `front.csv`, by the first objective.

        Where repeats differed, two more columns for each objective hold the ends of its interval.
        """
        names = [objective.name for objective in explorer.objectives]
        noisy = is_noisy(explorer.history)
        rows = []
        for point, values, intervals in explorer.recommended():
            ends = [end for name in names for end in intervals[name]] if noisy else []
            rows.append([*point.values(), *(values[name] for name in names), *ends])
        more = [f"{name}_{end}" for name in names for end in ("low", "high")] if noisy else []
        self._replace(FRONT, table([*explorer.space.names, *names, *more], rows))

    @staticmethod
    def _read(space: Space, explorer: Explorer, row: list[str]) -> tuple[Configuration, Any]:
        # By position: older files may have columns of one name.
        first = 2 + len(space.parameters)
        objectives = [objective.name for objective in explorer.objectives]
        try:
            configuration = space.parse(dict(zip(space.names, row[2:first], strict=True)))
            cells = row[first : first + len(objectives)]
            failed = all(cell == "" for cell in cells)
            numbers = {} if failed else dict(zip(objectives, map(float, cells), strict=True))
            values = None if failed else mark_censored(numbers, row[-1])
        except ValueError as error:
            raise StateError(f"{EVALUATIONS}, number {row[0] if row else None}: {error}") from error
        return configuration, values

    def _damaged(self, error: Exception) -> DamagedStateError:
        return DamagedStateError(
            f"{self.path / STATE} is damaged ({error}): the explore command that measured here rebuilds it"
        )

    def _replace(self, name: str, text: str) -> None:
        fresh = self.path / f"{name}.new"
        with fresh.open("w", newline="", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        fresh.replace(self.path / name)


def header(explorer: Explorer) -> list[str]:
    """Return the columns of `evaluations.csv`.

    Raises ObjectiveError where an objective has the name of a parameter, or one of them that of a column
    which every such file has.
    """
    names = columns(explorer.space, explorer.objectives)
    first, last = ["number", "phase"], ["measured_in", "failure", CENSORED]
    if shared := [name for name in names if name in (*first, *last)]:
        raise ObjectiveError(
            f"{shared[0]!r} is a fixed column of {EVALUATIONS}: give the parameter or objective another name"
        )
    return [*first, *names, *last]


def made_here(explorer: Explorer) -> int:
    """Return the number of measurements of this exploration, including failures and repeats."""
    history = explorer.history
    return sum(len(values) for index, values in history.results.items() if history.phases[index] != IMPORTED)


def table(header: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return CSV text; floating-point numbers are written so that they read back exactly."""
    cells = ([_number(cell) if isinstance(cell, float) else cell for cell in row] for row in rows)
    return _line(header) + "".join(map(_line, cells))


def _number(value: float) -> str:
    """Return the shortest text that reads back as `value`; of a count as programs print it, without .0."""
    return repr(as_printed(value))


def _line(cells: Iterable[object]) -> str:
    """Return a row of CSV text. Python 3.11 quotes only those line ends that its own rows end with."""
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\r\n").writerow(cells)
    return text.getvalue().removesuffix("\r\n") + "\n"


def _whole_rows(path: Path) -> tuple[list[list[str]], int]:
    """Return the complete rows of a CSV file, and the byte where they end."""
    data = path.read_bytes()
    data = data[: data.rfind(b"\n") + 1]
    lines = [line + b"\n" for line in data.split(b"\n")[:-1]]
    rows: list[list[str]] = []
    ends: list[int] = []
    try:
        reader = csv.reader(line.decode() for line in lines)
        for row in reader:
            rows.append(row)
            ends.append(reader.line_num)
    except (UnicodeDecodeError, csv.Error) as error:
        raise StateError(f"{path} is damaged after line {ends[-1] if ends else 0}: {error}") from error
    if rows and len(rows[-1]) < len(rows[0]):  # a line break within a value
        rows, ends = rows[:-1], ends[:-1]
    return rows, sum(map(len, lines[: ends[-1]])) if ends else 0


def _lock(file: int, folder: Path) -> None:
    try:
        import fcntl
    except ImportError:  # Windows has no fcntl: the folder is not locked there
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise StateError(
            f"another process is exploring in {folder}: wait for it, or use another --out"
        ) from None
