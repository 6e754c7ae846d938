"""A worker runs its own command with the values of a lease."""

import sys
from pathlib import Path
from typing import Any

import pytest

from client_kit.console import Console, NullStream
from client_kit.delivery.server import ProblemError, Server
from client_kit.evaluation import read_lease
from client_kit.home import Home
from frontrunner.__main__ import main
from frontrunner.worker import ProgramWorker
from tests.builders import manifests
from wire.lease import Result

# Of a user's own program.
LEASE = manifests.lease(
    application="program",
    configuration={"x": 0.5, "mode": None},
    frames=None,
    stop_after=0,
    learned_on=0,
    objectives=["cost"],
    feasible=["valid", "yes"],
    heartbeat_seconds=0.05,
    timeout_seconds=60.0,
    grace_seconds=0.2,
)


def no_pause(_: float) -> None:
    """Nothing here waits for a server."""


def measured(tmp_path: Path, script: str, **more: Any) -> Result | None:
    (tmp_path / "program.py").write_text(script)
    command = f"{sys.executable} {tmp_path / 'program.py'} {{x}} '{{mode}}' {{config}}"
    server, console = Server("http://127.0.0.1:1"), Console(NullStream())
    worker = ProgramWorker(server, "program-0", "token", Home(tmp_path), console, no_pause, command=command)
    return worker.measure(read_lease(LEASE | more))


def test_the_values_of_the_lease_fill_its_own_command(tmp_path: Path) -> None:
    script = (
        "import sys, json; print(json.dumps({'cost': len(sys.argv[3]) + float(sys.argv[1]), 'valid': 'yes'}))"
    )
    result = measured(tmp_path, script)
    assert result is not None
    assert (result.status, result.values) == ("done", {"cost": len('{"x": 0.5, "mode": null}') + 0.5})
    assert result.configuration == LEASE["configuration"]


@pytest.mark.parametrize(
    ("script", "error"),
    [
        ("import sys; sys.exit('no memory')", "exit code 1: no memory"),
        ('print(\'{"cost": 1, "valid": "false"}\')', "valid is false"),
        ('print(\'{"valid": "yes"}\')', "its last line: objective 'cost' is missing"),
    ],
)
def test_what_fails_is_reported_with_its_reason(tmp_path: Path, script: str, error: str) -> None:
    result = measured(tmp_path, script)
    assert result is not None
    assert result.status == "failed"
    assert result.error.startswith(error)


def test_a_program_that_breaks_a_condition_is_ended_and_its_bounds_are_named(tmp_path: Path) -> None:
    script = (
        "import signal\n"
        "signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        "for rate in (9, 3, 2):\n"
        "    print(f'report rate={rate} cost~{rate}.5', flush=True)\n"
        "while True:\n"
        "    signal.pause()\n"
    )
    more = {"objectives": ["cost", "rate"], "maximised": ["rate"], "stop_above": [{"rate": 2.5}]}
    result = measured(tmp_path, script, **more)
    assert result is not None
    assert (result.status, result.values) == ("done", {"cost": 2.5, "rate": 2.0})
    assert (result.censored, result.stopped_at) == (["rate"], 3)


def test_the_program_ends_when_the_lease_is_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def heartbeat(*_: Any) -> None:
        raise ProblemError(410, "lease_gone", "it is gone")

    monkeypatch.setattr(Server, "heartbeat", heartbeat)
    script = f"import signal; signal.pause(); open({str(tmp_path / 'late')!r}, 'w')"
    assert measured(tmp_path, script) is None
    assert not (tmp_path / "late").exists()


def test_a_wrong_command_line_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    token = tmp_path / "token"
    options = ["--token-file", str(token), "--command", "true", "--folder", str(tmp_path)]
    assert main(["worker", "http://127.0.0.1:1", *options]) == 2
    token.write_text("abc")
    assert main(["worker", "ftp://host", *options]) == 2
    errors = capsys.readouterr().err.splitlines()
    assert errors[0] == f"frontrunner: {token}: No such file or directory"
    assert "ftp://host" in errors[1]
    assert len(errors) == 2
