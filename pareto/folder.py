"""An exploration on disk: every measurement appended as it arrives, and a state to go on from."""

from __future__ import annotations

import csv
import io
import json
import os
from pathlib import Path
from typing import Any

from pareto.errors import StateError
from pareto.explorer import Explorer
from pareto.space import Configuration, Space

EVALUATIONS, FRONT, STATE = "evaluations.csv", "front.csv", "state.json"


class Folder:
    """Keeps `evaluations.csv`, `front.csv` and `state.json` of one exploration.

    The state is replaced whenever something was asked; measurements go to the CSV file only. After a crash
    at any moment the state and the rows it does not know yet give the explorer back as it was.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    def resume(self, space: Space) -> Explorer | None:
        """Return the explorer that was at work here, or None when there was none.

        Raises StateError when the folder holds another space's exploration or a damaged file.
        """
        try:
            state = json.loads((self.path / STATE).read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None
        except ValueError as error:
            raise StateError(f"{self.path / STATE} is damaged: {error}") from error
        explorer = Explorer.restore(space, state)
        self._drop_torn_line()
        known = sum(len(measurements) for measurements in explorer.history.told.values())
        for row in self.rows()[known:]:
            configuration, values = self._read(space, explorer, row)
            explorer.tell([configuration], [values], phase=row[1])
        return explorer

    def asked(self, explorer: Explorer) -> None:
        """Save the state: before a batch is measured, so that it can be finished after a crash."""
        self.path.mkdir(parents=True, exist_ok=True)
        self._replace(STATE, json.dumps(explorer.state()) + "\n")

    def append(
        self,
        explorer: Explorer,
        configuration: Configuration,
        values: dict[str, float] | None,
        seconds: float,
        error: str,
    ) -> None:
        """Write one measurement to `evaluations.csv`, safely on disk when this returns."""
        path = self.path / EVALUATIONS
        fresh = not path.exists() or path.stat().st_size == 0
        names = [objective.name for objective in explorer.objectives]
        number = sum(len(measurements) for measurements in explorer.history.told.values())
        index = explorer.space.encode(configuration)
        with path.open("a", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            if fresh:
                writer.writerow(["number", "phase", *explorer.space.names, *names, "measured_in", "failure"])
            measured = ["" if values is None else repr(values[name]) for name in names]
            phase = explorer.history.phases[index]
            reason = " ".join(error.split())
            writer.writerow([number, phase, *configuration.values(), *measured, f"{seconds:.3f}", reason])
            file.flush()
            os.fsync(file.fileno())

    def rows(self) -> list[list[str]]:
        """Return the rows of `evaluations.csv` below its header; there may be none yet."""
        path = self.path / EVALUATIONS
        if not path.exists():
            return []
        with path.open(newline="", encoding="utf-8") as file:
            return list(csv.reader(file))[1:]

    def write_front(self, explorer: Explorer) -> None:
        """Write the present front to `front.csv`, by the first objective."""
        names = [objective.name for objective in explorer.objectives]
        text = io.StringIO(newline="")
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow([*explorer.space.names, *names])
        for point, values in explorer.front():
            writer.writerow([*point.values(), *(repr(values[name]) for name in names)])
        self._replace(FRONT, text.getvalue())

    @staticmethod
    def _read(space: Space, explorer: Explorer, row: list[str]) -> tuple[Configuration, Any]:
        # By position: a parameter or an objective may well be called "number" or "failure".
        first = 2 + len(space.parameters)
        objectives = [objective.name for objective in explorer.objectives]
        try:
            configuration = {
                item.name: item.parse(cell) for item, cell in zip(space.parameters, row[2:first], strict=True)
            }
            cells = row[first : first + len(objectives)]
            failed = all(cell == "" for cell in cells)
            values = None if failed else dict(zip(objectives, map(float, cells), strict=True))
        except ValueError as error:
            raise StateError(f"{EVALUATIONS}, number {row[0] if row else None}: {error}") from error
        return configuration, values

    def _drop_torn_line(self) -> None:
        # A line half written in a crash would run into the next one; its measurement will be made again.
        path = self.path / EVALUATIONS
        if path.exists():
            with path.open("r+b") as file:
                file.truncate(file.read().rfind(b"\n") + 1)

    def _replace(self, name: str, text: str) -> None:
        fresh = self.path / f"{name}.new"
        with fresh.open("w", newline="", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        fresh.replace(self.path / name)
