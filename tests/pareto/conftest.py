"""A small space and its table, for everything that is run from the command line."""

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from threadpoolctl import threadpool_limits

from pareto.cli.commands import main
from pareto.measuring.folder import Folder

SPACE = {
    "name": "toy",
    "parameters": [
        {"name": "x", "type": "integer", "minimum": 1, "maximum": 20},
        {"name": "mode", "type": "categorical", "values": ["a,b", "c"]},
    ],
}


@pytest.fixture(autouse=True, scope="session")
def one_thread() -> Iterator[None]:
    """On the tests' small matrices, threads of BLAS mostly wait for each other: minutes on a busy machine."""
    with threadpool_limits(limits=1, user_api="blas"):
        yield


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    """A folder with space.json and table.csv: x lowers error and costs seconds; 7 failed, 20 is missing."""
    (tmp_path / "space.json").write_text(json.dumps(SPACE))
    with (tmp_path / "table.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["x", "mode", "error", "seconds", "note"])
        for x in range(1, 20):
            for mode in ("a,b", "c"):
                error = "failed" if x == 7 else 1 / x + (mode == "c")
                writer.writerow([x, mode, error, x, "-"])
    return tmp_path


def explore(toy: Path, *more: str, source: list[str] | None = None, out: str = "out") -> int:
    """Run the command at random over the table into a folder of `toy`, undrawn; return its exit code."""
    source = source or ["--table", str(toy / "table.csv")]
    space = ["--space", str(toy / "space.json"), "--objectives", "error,seconds"]
    quick = ["--method", "random", "--no-picture"]
    return main(["explore", *space, *source, *quick, "--out", str(toy / out), *more])


def rows(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def interrupt_after(monkeypatch: pytest.MonkeyPatch, measurements: int) -> None:
    """Let a search be interrupted, as by Ctrl-C, when it has stored so many `measurements` more."""
    append, left = Folder.append, measurements

    def interrupted(*arguments: Any, **names: Any) -> None:
        nonlocal left
        left -= 1
        if left < 0:
            raise KeyboardInterrupt
        append(*arguments, **names)

    monkeypatch.setattr(Folder, "append", interrupted)
