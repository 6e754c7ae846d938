"""The command line in this process, on a machine that always measures the same."""

from collections.abc import Callable
from pathlib import Path

import pytest

from client_kit import __main__ as command_line
from client_kit.home import Home
from client_kit.measuring import measurement
from client_kit.participating import participation
from tests.builders import manifests
from tests.client_kit import canned
from tests.client_kit.counting import Counting
from tests.client_kit.killed import DEVICE, IDENTITY
from tests.client_kit.scripted import ScriptedServer

Serve = Callable[..., ScriptedServer]
CHUNKS = (b"header", b"frames")


@pytest.fixture
def counting(tmp_path: Path) -> Counting:
    for chunk in CHUNKS:
        (tmp_path / manifests.digest(chunk)).write_bytes(chunk)
    return Counting(manifests.manifest(CHUNKS), tmp_path)


@pytest.fixture(autouse=True)
def canned_measurement(monkeypatch: pytest.MonkeyPatch, home: Home) -> None:
    """A machine that always measures the same, with the home folder of the test."""
    monkeypatch.setenv("FRONTRUNNER_HOME", str(home.path))
    monkeypatch.setattr(measurement, "measure", lambda _, asked, plan, **__: canned.measured(asked, plan))
    monkeypatch.setattr(participation, "_device", lambda *_: (DEVICE, IDENTITY))


class Terminal:
    """The command line in this process."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def __call__(self, *arguments: str) -> tuple[int, str, str]:
        """Exit code, standard output and error; AssertionError where an error is not one line."""
        code = command_line.main(arguments)
        output = self._capsys.readouterr()
        assert len(output.err.splitlines()) == (1 if code else 0), output.err
        return code, output.out, output.err


@pytest.fixture
def client(capsys: pytest.CaptureFixture[str]) -> Terminal:
    return Terminal(capsys)
