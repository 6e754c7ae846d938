"""The whole command on real systems, killed once: what was finished is kept, and the page is complete."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from frontrunner.__main__ import main
from tests.waiting import until

ROOT = Path(__file__).parents[3]
PROGRAM = [sys.executable, "-m", "tests.frontrunner.paper.tiny"]
ROWS = {
    "kfusion": 4 + 1,
    "elasticfusion": 2 + 1,
    "kfusion-references": 3,
    "elasticfusion-references": 3,
    "surface": 8,
}


def rows(folder: Path) -> dict[str, list[str]]:
    """The finished rows of each file."""
    tables = {path.parent.name: path.read_text() for path in sorted(folder.glob("*/evaluations.csv"))}
    return {
        name: [line for line in table.splitlines(keepends=True)[1:] if line.endswith("\n")]
        for name, table in tables.items()
    }


def kill_after(count: int, folder: Path) -> dict[str, list[str]]:
    """Run until so many rows are there, kill it, and leave nothing else; return the rows."""
    with subprocess.Popen([*PROGRAM, str(folder)], cwd=ROOT) as program:
        until(
            lambda: program.poll() is not None or sum(map(len, rows(folder).values())) >= count,
            seen=lambda: rows(folder),
        )
        assert program.poll() is None, "it ended before it could be killed"
        program.send_signal(signal.SIGKILL)
    for path in folder.rglob("*"):
        if path.is_file() and path.name != "evaluations.csv":
            path.unlink()
    return rows(folder)


@pytest.mark.slow
def test_the_paper_that_was_killed_keeps_every_row_and_ends_with_a_whole_page(tmp_path):
    killed = kill_after(6, tmp_path)  # the defaults, and all random samples of KinectFusion
    ended = subprocess.run([*PROGRAM, str(tmp_path)], cwd=ROOT, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    assert "hours are left on this machine: KinectFusion" in ended.stderr

    last = rows(tmp_path)
    assert {name: len(lines) for name, lines in last.items()} == ROWS
    for name, lines in killed.items():
        assert last[name][: len(lines)] == lines
    text = (tmp_path / "paper.md").read_text()
    assert "not measured yet" not in text
    assert "2 rounds: a single time varies by" in text
    assert (tmp_path / "paper.html").stat().st_size > 1_000_000


def test_a_server_that_does_not_answer_ends_the_command_before_it_measures(tmp_path, capsys):
    assert main(["paper", "--out", str(tmp_path / "out"), "--server", "http://127.0.0.1:1"]) == 2
    assert "--server http://127.0.0.1:1 does not answer" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_an_unknown_budget_is_one_line(tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["paper", "--out", str(tmp_path), "--budget", "huge"])
    assert "invalid choice: 'huge'" in capsys.readouterr().err
