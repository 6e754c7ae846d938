"""A demo server, as the examples of the API pages need it, and one request of each call."""

import json
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any
from urllib.error import HTTPError
from urllib.parse import urlencode
from urllib.request import Request, urlopen

import numpy as np

from crowd.explorations.measuring import leases
from crowd.explorations.measuring.tokens import issue_token
from crowd.explorations.models import Evaluation, Exploration
from crowd.results.figures import recomputing
from crowd.results.opendata import exports
from crowd.simulation.crowd import Crowd
from crowd.simulation.sessions import session
from crowd.simulation.transport import Transport
from tests.builders.explorations import measurement
from tests.builders.participant import API

TODAY = datetime(2026, 11, 20, tzinfo=UTC)


@dataclass(frozen=True)
class Wish:
    """What a call needs on this server: values of its path, query and headers, a body, a token."""

    path: dict[str, str] = field(default_factory=dict)
    query: dict[str, Any] = field(default_factory=dict)
    headers: dict[str, str] = field(default_factory=dict)
    body: Any = None
    token: str = ""


@dataclass(frozen=True)
class Answered:
    """A status, and the JSON that came with it."""

    status: int
    content: Any


class ExampleServer:
    """Asks the server at URL."""

    def __init__(self, url: str, exploration: Exploration) -> None:
        self.url, self.exploration = url, exploration
        self.board = issue_token(exploration.reference_device)
        self.crowd = Crowd(Transport(), 3, 0, TODAY, sessions=2)
        list(self.crowd.send())
        recomputing.recompute(lambda _done: None)
        exports.create_export()
        self.device = self.read("/speedups", limit=1, backend="opencl")[0]["device"]
        slugs = [row["slug"] for row in self.read("/devices")]
        self.other = next(slug for slug in slugs if slug != self.device)
        self.session = self.read("/sessions", limit=1)[0]["id"]

    def read(self, path: str, **query: Any) -> Any:
        return self.ask("GET", f"{API}{path}?{urlencode(query)}").content["results"]

    def ask(self, method: str, path: str, body: Any = None, token: str = "", **headers: str) -> Answered:
        request = Request(
            f"{self.url}{path}",
            method=method,
            data=None if body is None else json.dumps(body).encode(),
            headers={"Content-Type": "application/json"}
            | ({"Authorization": f"Bearer {token}"} if token else {})
            | headers,
        )
        try:
            with urlopen(request, timeout=60) as response:
                content = response.read()
                return Answered(response.status, json.loads(content) if content else None)
        except HTTPError as error:
            return Answered(error.code, json.loads(error.read()))

    def enrolled(self) -> str:
        """The token of a new installation."""
        token: str = self.ask("POST", f"{API}/enrol", ENROLMENT).content["token"]
        return token

    def submitted(self) -> tuple[str, str, str]:
        """The token of a new installation that sent a session, the submission's id, a run's."""
        token, body = self.enrolled(), self.submission_body()
        answer = self.ask("POST", f"{API}/submissions", body, token, **{"Idempotency-Key": str(uuid.uuid4())})
        assert answer.status == 202, answer.content
        return token, answer.content["submission_id"], answer.content["items"][0]["id"]

    def leased(self) -> tuple[dict[str, str], dict[str, Any]]:
        """Where a new lease of the board goes on, and what it asks for."""
        self.give_back()
        lease = self.ask(
            "POST", f"{API}/leases", {"worker": "board 7", "lease_version": 2}, self.board
        ).content
        key, attempt = lease["id"].split("-")
        return {"key": key, "attempt": attempt}, lease

    def give_back(self) -> None:
        """End what the board measures now: it has one machine."""
        for evaluation in Evaluation.objects.filter(state=Evaluation.State.RUNNING):
            leases.return_evaluation(evaluation)

    def submission_body(self) -> dict[str, Any]:
        """A simulated session that was not sent yet, with new ids."""
        device = self.crowd.devices[0]
        document = session(
            device, 0, 0, self.crowd.front, self.crowd.manifest, False, TODAY, np.random.default_rng(9)
        )
        document["id"] = str(uuid.uuid4())
        for run in document["runs"]:
            run["id"] = str(uuid.uuid4())
        return {
            "schema_version": 1,
            "app_version": "0.1.0",
            "consent_version": 2,
            "device": device.description(0, 0),
            "sessions": [document],
        }


def wanted(server: ExampleServer, call: str) -> Wish:
    """What an example of `call` asks of `server` now."""
    wish = WISHES[call]
    return wish if isinstance(wish, Wish) else wish(server)


def _of_own(server: ExampleServer) -> Wish:
    return Wish(token=server.submitted()[0])


def _submission(server: ExampleServer) -> Wish:
    token, key, _ = server.submitted()
    return Wish(path={"key": key}, token=token)


def _run(server: ExampleServer) -> Wish:
    token, _, run = server.submitted()
    return Wish(path={"key": run}, token=token)


def _result(server: ExampleServer) -> Wish:
    path, lease = server.leased()
    found = measurement(lease["configuration"])
    body = {"status": "done", "objectives": found.objectives, "stages": found.stages, "device": found.device}
    body["parts"] = [
        {"sequence": pack["name"], "lost": 0, "objectives": found.objectives} for pack in lease["sequences"]
    ]
    return Wish(path=path, token=server.board, body=body | {"software": "client_kit 0.1.0"})


def _lease(server: ExampleServer) -> Wish:
    server.give_back()
    return Wish(body={"worker": "board 7", "lease_version": 2}, token=server.board)


def _sent(server: ExampleServer) -> Wish:
    key = str(uuid.uuid4())
    return Wish(body=server.submission_body(), token=server.enrolled(), headers={"Idempotency-Key": key})


ENROLMENT = {"app": "example", "app_version": "0.1.0", "consent_version": 2}
ATTEMPT = {
    "step": "began",
    "reason": None,
    "gpu_vendor": "arm",
    "gpu_architecture": None,
    "browser": "Chrome",
}
# In an order in which each finds what it needs.
WISHES: dict[str, Wish | Callable[[ExampleServer], Wish]] = {
    "speedups": Wish(query={"limit": 1}),
    "devices": Wish(query={"limit": 1}),
    "device": lambda server: Wish(path={"slug": server.device}),
    "compare": lambda server: Wish(query={"devices": f"{server.device},{server.other}"}),
    "sessions": Wish(query={"limit": 1, "valid": 1}),
    "session": lambda server: Wish(path={"key": server.session}),
    "runs": Wish(query={"limit": 1, "configuration": "best"}),
    "exports": Wish(query={"limit": 1}),
    "manifest": Wish(query={"application": "kfusion"}),
    "fronts": Wish(query={"limit": 1}),
    "front": Wish(path={"version": "kfusion-test"}),
    "recommendation": lambda server: Wish(query={"model": server.device}),
    "models": Wish(query={"search": "iphone"}),
    "explorations": Wish(query={"limit": 1}),
    "exploration": lambda server: Wish(path={"key": str(server.exploration.pk)}, query={"limit": 2}),
    "enrol": Wish(body=ENROLMENT),
    "validate": lambda server: Wish(body=server.submission_body(), token=server.enrolled()),
    "submit": _sent,
    "submission": _submission,
    "attempt": Wish(body=ATTEMPT),
    "own": _of_own,
    "choose": lambda server: Wish(body={"show_model": False}, token=server.submitted()[0]),
    "own_data": _of_own,
    "renew_token": _of_own,
    "erase_run": _run,
    "erase": _of_own,
    "lease": _lease,
    "heartbeat": lambda server: Wish(path=server.leased()[0], token=server.board),
    "result": _result,
}
