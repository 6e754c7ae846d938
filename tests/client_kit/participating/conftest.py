"""Servers that count what they get, and measurements that were made before."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from client_kit.measuring import measurement
from client_kit.participating import participation
from tests.builders import manifests
from tests.client_kit import canned, room
from tests.client_kit.counting import Counting


@pytest.fixture
def counting(tmp_path: Path) -> Counting:
    return Counting.with_chunks(tmp_path, manifests.manifest())


@pytest.fixture
def canned_measurement(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine that always measures the same."""
    monkeypatch.setattr(measurement, "measure", canned.measure)
    monkeypatch.setattr(participation, "_device", lambda *_: (canned.DEVICE, canned.IDENTITY))


@pytest.fixture
def recorded(watched: room.Watched) -> Iterator[None]:
    """Measurements give what was really measured once."""
    with watched.replayed():
        yield
