"""kill -9 at many moments of `run`: no finished run is lost, no session is sent twice."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.client_kit.commands import PROJECT
from tests.client_kit.counting import Counting
from tests.client_kit.scripted import Serve


@pytest.mark.slow
@pytest.mark.parametrize("stride", [71, pytest.param(43, marks=pytest.mark.exhaustive)])
@pytest.mark.skipif(not hasattr(os, "fork"), reason="this platform has no fork")
def test_killed_anywhere_a_run_ends_with_every_session_counted_once(
    stride: int, tmp_path: Path, serve: Serve, counting: Counting
) -> None:
    server = serve(counting)

    done = subprocess.run(
        [sys.executable, "-m", "tests.client_kit.killed", str(tmp_path / "homes"), server.url, str(stride)],
        cwd=PROJECT,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )

    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    kills = report["kills"]
    assert len(kills) > 30
    for kill in kills:
        assert kill["status"] == [signal.SIGKILL, 0], (kill, done.stderr)
        # What was kept when it was killed is there at the end, with the session of the second run.
        assert kill["end"] == ["accepted"] * (len(kill["after"]) + 1), kill
    # Moments before, between and after the two sessions were all met.
    assert {len(kill["after"]) for kill in kills} == {0, 1, 2}
    assert {state for kill in kills for state in kill["after"]} >= {"draft", "queued", "sending", "accepted"}
    expected = 2 + sum(len(kill["end"]) for kill in kills)
    assert len(counting.sessions) == expected
    # All 4 runs of a session, or those that were finished when it was killed.
    interrupted = [one for one in counting.sessions.values() if len(one["runs"]) < 4]
    assert 0 < len(interrupted) <= sum("draft" in kill["after"] for kill in kills)
    finished = 4 * expected - sum(4 - len(one["runs"]) for one in interrupted)
    assert len(counting.runs) == len(set(counting.runs)) == finished
