"""Prometheus itself, where it is installed (Debian's package), takes the alerts and finds that they fire."""

import shutil
import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).parent
RULES = HERE.parents[1] / "deploy" / "prometheus-rules.yml"


@pytest.mark.skipif(shutil.which("promtool") is None, reason="Debian's package prometheus is missing")
@pytest.mark.parametrize("words", [("check", "rules", RULES), ("test", "rules", HERE / "rules.test.yml")])
def test_promtool_finds_nothing_wrong(words: tuple[str, ...]) -> None:
    done = subprocess.run(["promtool", *map(str, words)], capture_output=True, text=True, check=False)

    assert done.returncode == 0, done.stdout + done.stderr
