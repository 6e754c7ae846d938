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
from tests.builders.spaces import described

SPACE = {"name": "toy"} | described(x=range(1, 21), mode=["a,b", "c"])


SCENARIO = {
    "optimization_objectives": ["error", "seconds"],
    "input_parameters": {
        "x": {"parameter_type": "integer", "values": [1, 20]},
        "mode": {"parameter_type": "categorical", "values": ["a,b", "c"]},
    },
}  # the same space and objectives, as HyperMapper has them


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


def arguments(
    toy: Path, *more: str, source: list[str] | None = None, out: str = "out", picture: bool = False
) -> list[str]:
    """Those of a search at random over the table, or another `source`, into a folder of `toy`."""
    source = source or ["--table", str(toy / "table.csv")]
    space = ["--space", str(toy / "space.json"), "--objectives", "error,seconds"]
    quick = ["--method", "random", *([] if picture else ["--no-picture"])]
    return ["explore", *space, *source, *quick, "--out", str(toy / out), *more]


def explore(toy: Path, *more: str, **how: Any) -> int:
    """Run the command of these `arguments`; return its exit code."""
    return main(arguments(toy, *more, **how))


def explored_rows(toy: Path, *more: str, out: str = "out", **how: Any) -> list[dict[str, str]]:
    """The rows that the command of these `arguments` leaves when it ends well."""
    assert explore(toy, *more, out=out, **how) == 0
    return rows(toy / out / "evaluations.csv")


def complaint(capsys: pytest.CaptureFixture[str]) -> str:
    """What the last command printed to its error output: one line."""
    error = capsys.readouterr().err
    assert error.count("\n") == 1, error
    return error


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
