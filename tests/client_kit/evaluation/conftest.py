"""A lab that is served, and a machine that measures what the test says."""

import io
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from client_kit import evaluation
from client_kit.console import Console
from client_kit.delivery.server import Server
from client_kit.evaluation import serve
from client_kit.home import Home
from slam.datasets.formats.pack import Pack
from slam.isolated import LeaseLostError, Measurement
from tests.client_kit import room
from tests.client_kit.evaluation.lab import MEASURED, Lab


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Pack:
    return room.write(tmp_path_factory.mktemp("sequences") / "room")


@pytest.fixture
def serve_lab(tmp_path: Path) -> Callable[[Lab], tuple[str, list[float]]]:
    """Serves a lab until nothing waits: what was said, and how long was waited."""

    def served(lab: Lab) -> tuple[str, list[float]]:
        pauses: list[float] = []
        home, said = Home(tmp_path / "home"), io.StringIO()
        home.prepare()
        try:
            server = Server(lab.server.url)
            serve(server, "board", "secret", home, Console(said), until_idle=True, pause=pauses.append)
        finally:
            lab.server.close()
        return said.getvalue(), pauses

    return served


@pytest.fixture(autouse=True)
def choices(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, tuple[str, ...]]]:
    """For which device and backends a machine with one GPU was asked; OpenCL drives it, where it may."""
    asked: list[tuple[str, tuple[str, ...]]] = []

    def choose(text: str, backends: tuple[str, ...]) -> SimpleNamespace:
        asked.append((text, backends))
        return SimpleNamespace(label=f"Board {text} (a platform, 1, driver 1)", backend=backends[0])

    monkeypatch.setattr(evaluation.selection, "choose", choose)
    return asked


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """What was measured; each measurement makes one heartbeat and gives MEASURED."""
    calls: list[dict[str, Any]] = []

    def measure(system: str, configuration: Any, packs: list[Path], **wishes: Any) -> Measurement:
        calls.append({"system": system, "configuration": configuration, "packs": packs, **wishes})
        if not wishes["heartbeat"]():
            raise LeaseLostError
        return MEASURED

    monkeypatch.setattr(evaluation.isolated, "measure", measure)
    return calls
