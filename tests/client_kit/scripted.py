"""An HTTP server on a real socket that answers as a test tells it to, for the protocol's own behaviour."""

import json
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


class ScriptedServer:
    """Answers each request with what `answer` returns for it, and remembers all requests."""

    def __init__(self, answer: Callable[[Request], Reply], port: int = 0) -> None:
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

    def close(self) -> None:
        self._httpd.shutdown()
        self._httpd.server_close()
        self._thread.join()
