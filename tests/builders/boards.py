"""A machine that serves as a reference device over HTTP, and what it sends."""

from typing import Any

from django.test import Client

from crowd.explorations.measuring.tokens import issue_token
from crowd.explorations.models import ReferenceDevice
from tests.builders.explorations import measurement

API = "/api/v1/leases"
CURRENT = {"lease_version": 2}  # what a client of this version asks with


class Board:
    """A machine that asks with its token: a new one of `device`, unless that is a token."""

    def __init__(self, client: Client, device: ReferenceDevice | str) -> None:
        token = device if isinstance(device, str) else issue_token(device)
        self.client, self.headers = client, {"Authorization": f"Bearer {token}"}

    def post(self, path: str, document: Any = None) -> Any:
        """The answer to `document`, to bytes as they are, or without one to what a current client asks."""
        document = CURRENT if document is None else document
        return self.client.post(API + path, document, "application/json", headers=self.headers)

    def ask(self) -> Any:
        """The answer to a request for a lease."""
        return self.post("", CURRENT | {"device": "bench", "worker": "board 7"})

    def take(self) -> dict[str, Any]:
        """A lease."""
        response = self.ask()
        assert response.status_code == 201, response.content
        lease: dict[str, Any] = response.json()
        return lease

    def send(self, lease: dict[str, Any], document: Any) -> Any:
        """The answer to the result `document` of `lease`."""
        return self.post(f"/{lease['id']}/result", document)


def done(lease: dict[str, Any], **changes: float) -> dict[str, Any]:
    """The result of `lease` that some machine might send; `changes` are those of its objectives."""
    found = measurement(lease["configuration"])
    objectives = found.objectives | changes
    return {
        "status": "done",
        "objectives": objectives,
        "stages": found.stages,
        "device": found.device,
        "parts": [{"sequence": "tiny", "lost": 0, "objectives": objectives}],
        "software": "client_kit 0.1.0",
    }


def problem(response: Any) -> tuple[int, str]:
    """Status and code of a refusal."""
    assert response.headers["Content-Type"] == "application/problem+json"
    return response.status_code, response.json()["code"]
