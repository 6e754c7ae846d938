"""docs/tune/tutorial.md works as it stands: its files are saved and its commands run."""

import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from frontrunner.__main__ import main as frontrunner
from tests.pareto.conftest import rows

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "tune" / "tutorial.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"Save this as `([\w.]+)`:\n\n```\w+\n(.*?)```", PAGE, re.DOTALL))
COMMANDS = re.findall(r"```console\n(.*?)```", PAGE, re.DOTALL)


def budgets(text):
    """The page's budgets, in shorter searches."""
    return re.sub(r"--budget (\d+)", lambda match: f"--budget {int(match[1]) // 4}", text)


def run(command):
    """The exit code of a command of the page; ours run in this process."""
    if command[0] == "frontrunner":
        return frontrunner(command[1:])
    return subprocess.run(command).returncode


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc to compile the tutorial's program")
def test_the_page_tunes_a_program_from_nothing(tmp_path, monkeypatch, capfd):
    assert list(FILES) == ["matmul.c", "measure.sh", "space.json"]
    assert len(COMMANDS) == 5
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    printed = []
    for block in COMMANDS:
        for line in budgets(block).replace("\\\n", "").splitlines():
            assert run(shlex.split(line)) == 0, capfd.readouterr().err
        printed.append(capfd.readouterr().out)
    checked, searched, front, picked, _ = printed
    assert checked.startswith("matmul: 1,350 points, of which conditions allow 630\n")
    assert json.loads(checked.splitlines()[-1]).keys() == {"seconds", "error"}
    # Times differ, so the second measurement of the default has shown the noise.
    assert "points recommended: run/front.csv" in searched
    assert len(front.splitlines()) > 1
    default, *others = rows(tmp_path / "run" / "evaluations.csv")
    assert len(others) == 19
    assert (default["algorithm"], default["block"], default["type"]) == ("dots", "", "double")
    assert {row["failure"] for row in others} == {""}
    columns, values = (line.split(",") for line in picked.splitlines()[:2])
    best = dict(zip(columns, values, strict=True))
    assert best["type"] == "double"
    assert float(best["error"]) <= 1e-9
    assert float(best["seconds"]) < float(default["seconds"])
    assert (tmp_path / "run" / "front.html").stat().st_size > 1_000_000


def test_the_tutorial_is_linked_from_the_overviews():
    for page, link in (("README.md", "docs/tune/tutorial.md"), ("docs/tune/command-line.md", "tutorial.md")):
        assert f"({link})" in (ROOT / page).read_text(encoding="utf-8")
