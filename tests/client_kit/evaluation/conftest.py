"""A lab that is served, and a machine that measures what the test says."""

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from client_kit import evaluation
from client_kit.home import Home
from slam.datasets.formats.pack import Pack
from slam.isolated import LeaseLostError, Measurement
from tests.client_kit.evaluation.lab import MEASURED, Lab


@pytest.fixture
def lab(pack: Pack, home: Home) -> Iterator[Lab]:
    """A lab with one lease over the room."""
    lab = Lab(pack, home)
    yield lab
    lab.server.close()


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
