"""A server with leases to give, and what is measured for one."""

import io
import json
from collections.abc import Callable
from typing import Any

import pytest

from client_kit import evaluation
from client_kit.console import Console
from client_kit.delivery.server import Server
from client_kit.evaluation import serve
from client_kit.home import Home
from slam.datasets.formats.pack import Pack
from slam.isolated import Measurement
from tests.builders import manifests
from tests.client_kit import room
from tests.client_kit.scripted import Reply, Request, ScriptedServer

MEASURED = Measurement(
    {"runtime": 0.02, "ate_max": 0.01},
    {"computation": 0.02},
    {"name": "Board GPU", "driver": "1"},
    ({"sequence": "room", "lost": 1, "stopped_at": None, "runtime": 0.02, "ate_max": 0.01},),
)


class Lab:
    """A server with leases to give, which answers heartbeats and results as the test says.

    `home`: of the client that serves it.
    """

    def __init__(self, pack: Pack, home: Home) -> None:
        self.home, self.said, self.pauses = home, io.StringIO(), list[float]()
        self.left, self.packs = 1, [pack]  # leases, and the sequences that they name
        self.sequence = room.manifest(pack)["sequence"]
        self.results: list[dict[str, Any]] = []
        self.heartbeat = Reply(200, {"lease_seconds": 90})
        self.refusals: list[Reply] = []
        self.unreadable = 0  # leases of a version that this client does not know
        self.trouble: list[Reply] = []  # before a part of the sequence is given
        self.heartbeat_seconds = 15.0
        self.more: dict[str, Any] = {}  # other members of its leases
        self.server = ScriptedServer(self.answer)

    def answer(self, request: Request) -> Reply:
        if request.path.startswith("/sequences/"):
            if self.trouble:
                return self.trouble.pop(0)
            digest = request.path.rpartition("/")[2]
            chunks = [pack._chunks.folder / "chunks" / digest for pack in self.packs]
            return Reply(raw=next(chunk.read_bytes() for chunk in chunks if chunk.exists()))
        assert request.headers["authorization"] == "Bearer secret"
        if request.path.endswith("/heartbeat"):
            return self.heartbeat
        if self.refusals:
            return self.refusals.pop(0)
        if request.path.endswith("/result"):
            self.results.append(json.loads(request.body))
            return Reply(200, {"state": "done"})
        if not self.left:
            return Reply(204, raw=b"")
        self.left -= 1
        if self.left < self.unreadable:
            return Reply(201, {"id": "6-1", "tasks": []})
        lease = manifests.lease(sequences=[self.sequence], heartbeat_seconds=self.heartbeat_seconds)
        return Reply(201, lease | self.more)

    def serve(self, pause: Callable[[float], None] | None = None, **wishes: Any) -> str:
        """Serve as its device until nothing waits; what was said. `pauses` holds the waits."""
        options = {"until_idle": True, "pause": pause or self.pauses.append} | wishes
        serve(Server(self.server.url), "board", "secret", self.home, Console(self.said), **options)
        return self.said.getvalue()

    def states(self) -> list[str]:
        """Of the results that it got."""
        return [result["status"] for result in self.results]


def failing(monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    """Have each measurement raise `error`."""

    def measure(*_: Any, **__: Any) -> Measurement:
        raise error

    monkeypatch.setattr(evaluation.isolated, "measure", measure)
