import math
import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from client_kit.delivery.spool import Spool
from client_kit.home import Home
from slam.datasets.formats.pack import Pack
from tests.client_kit import room
from tests.client_kit.commands import Terminal
from tests.client_kit.scripted import Answer, ScriptedServer, Serve
from tests.server import *  # noqa: F403 - its fixtures
from wire import session_statistics


@pytest.fixture(autouse=True)
def busy_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other tests on this machine disturb what is measured here, and decide nothing."""
    undisturbed(monkeypatch)


def undisturbed(patch: pytest.MonkeyPatch) -> None:
    """However long threads wait, no run is disturbed."""
    for limit in ("WAITED_A_FRAME_US", "MOST_WAITED"):
        patch.setattr(session_statistics, limit, math.inf)


@pytest.fixture
def home(tmp_path: Path) -> Home:
    home = Home(tmp_path / "home")
    home.prepare()
    return home


@pytest.fixture
def spool(home: Home) -> Spool:
    return Spool(home.spool)


@pytest.fixture
def programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in front of PATH, for programs that play those of another machine."""
    folder = tmp_path / "programs"
    folder.mkdir()
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}/bin{os.pathsep}/usr/bin")
    return folder


@pytest.fixture
def serve() -> Iterator[Serve]:
    """Start a server that answers by a function; all are stopped at the end."""
    servers: list[ScriptedServer] = []

    def start(answer: Answer, port: int = 0) -> ScriptedServer:
        servers.append(ScriptedServer(answer, port))
        return servers[-1]

    yield start
    for server in servers:
        server.close()


@pytest.fixture
def terminal(
    home: Home, serve: Serve, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Terminal:
    """The command line in this process, over `home`."""
    monkeypatch.setenv("FRONTRUNNER_HOME", str(home.path))
    return Terminal(home, serve, capsys)


@pytest.fixture
def closed_port() -> int:
    """A port of this machine on which nothing listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture(scope="session")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Pack:
    """The room, alone in a folder of sequences. No test changes it."""
    return room.write(tmp_path_factory.mktemp("sequences") / "room")


@pytest.fixture(scope="session")
def watched(pack: Pack) -> room.Watched:
    """A session over the room that was really measured, once for all tests."""
    with pytest.MonkeyPatch.context() as patch:
        undisturbed(patch)
        return room.Watched(pack)
