"""An HTTP server on a real socket that answers as a test says, and the answers that tests give most."""

import json
import re
import ssl
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any


@dataclass(frozen=True)
class Request:
    method: str
    path: str
    headers: dict[str, str]
    body: bytes


@dataclass(frozen=True)
class Reply:
    """An answer; `cut` closes the connection after that many bytes of the body."""

    status: int = 200
    document: Any = None
    headers: tuple[tuple[str, str], ...] = ()
    raw: bytes | None = None
    cut: int | None = None


def problem(status: int, code: str, detail: str = "", **headers: str) -> Reply:
    pairs = (("Content-Type", "application/problem+json"), *headers.items())
    return Reply(status, {"code": code, "detail": detail, "status": status}, pairs)


Answer = Callable[[Request], Reply]


def accepted(*states: str) -> Reply:
    """The answer to a submission whose runs have these `states`."""
    codes = {"rejected": "why_rejected"}
    items = [{"id": "a run", "status": state, "code": codes.get(state)} for state in states]
    return Reply(202, {"submission_id": "submission 1", "items": items})


def accepting(request: Request) -> Reply:
    """Enrols every client and accepts every session."""
    if request.path.endswith("/enrol"):
        return Reply(201, {"installation_id": "me", "token": "secret"})
    if request.method == "DELETE":
        return Reply(204, raw=b"")
    return accepted("accepted")


def at_first(pattern: str, *replies: Reply, then: Answer = accepting) -> Answer:
    """Gives `replies` to the first requests whose path matches `pattern`; `then` answers the others."""
    left = list(replies)
    return lambda request: left.pop(0) if left and re.search(pattern, request.path) else then(request)


def always(pattern: str, reply: Reply, then: Answer = accepting) -> Answer:
    """Gives `reply` to each request whose path matches `pattern`; `then` answers the others."""
    return lambda request: reply if re.search(pattern, request.path) else then(request)


class ScriptedServer:
    """Answers each request with what `answer` returns for it, and remembers all requests.

    With a `context` it speaks TLS.
    """

    def __init__(self, answer: Answer, port: int = 0, context: ssl.SSLContext | None = None) -> None:
        self.requests: list[Request] = []
        self.answer = answer
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def _reply(self) -> None:
                body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
                headers = {name.lower(): value for name, value in self.headers.items()}
                request = Request(self.command, self.path, headers, body)
                outer.requests.append(request)
                reply = outer.answer(request)
                data = reply.raw if reply.raw is not None else json.dumps(reply.document).encode()
                self.send_response(reply.status)
                for name, value in reply.headers:
                    self.send_header(name.replace("_", "-"), value)
                self.send_header("Content-Length", str(len(data)))
                self.end_headers()
                self.wfile.write(data if reply.cut is None else data[: reply.cut])

            do_GET = do_POST = do_DELETE = _reply  # noqa: N815 - the names that http.server calls

            def log_message(self, *_: Any) -> None:
                pass

        class Quiet(ThreadingHTTPServer):
            def handle_error(self, *_: Any) -> None:
                """A client that hangs up, or is killed, is what some tests are about."""
                if not isinstance(sys.exc_info()[1], ConnectionError):
                    super().handle_error(*_)

        self._httpd = Quiet(("127.0.0.1", port), Handler)
        if context is not None:
            self._httpd.socket = context.wrap_socket(self._httpd.socket, server_side=True)
        self._thread = threading.Thread(target=self._httpd.serve_forever, args=(0.02,), daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._httpd.server_address[1]}"

    @property
    def port(self) -> int:
        return self._httpd.server_address[1]

    def paths(self) -> list[str]:
        return [f"{request.method} {request.path}" for request in self.requests]

    def submissions(self) -> list[Request]:
        return [request for request in self.requests if request.path.endswith("/submissions")]

    def close(self) -> None:
        self._httpd.shutdown()
        self._httpd.server_close()
        self._thread.join()


Serve = Callable[..., ScriptedServer]
