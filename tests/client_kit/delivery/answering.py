"""What scripted servers answer to what is delivered."""

from collections.abc import Callable

from tests.client_kit.scripted import Reply, Request, ScriptedServer

Serve = Callable[..., ScriptedServer]


def accepting(request: Request) -> Reply:
    """Enrols everybody and accepts everything."""
    if request.path.endswith("/enrol"):
        return Reply(201, {"installation_id": "me", "token": "secret"})
    if request.method == "DELETE":
        return Reply(204, raw=b"")
    return accepted("accepted")


def accepted(*states: str) -> Reply:
    items = [{"id": "a run", "status": state, "code": f"why_{state}" if state == "rejected" else None}
             for state in states]  # fmt: skip
    return Reply(202, {"submission_id": "submission 1", "items": items})


def submissions(scripted: ScriptedServer) -> list[Request]:
    return [request for request in scripted.requests if request.path.endswith("/submissions")]
