"""Sends requests to the API of this deployment in this process, without a server."""

import io
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from django.conf import settings
from django.core.handlers.wsgi import WSGIHandler
from django.core.signals import request_finished, request_started
from django.db import close_old_connections

API = "/api/v1"
THIS_MACHINE = "127.0.0.1"


class RefusedError(Exception):
    """The API refused a request; the message is its response."""


@dataclass(frozen=True)
class Response:
    """The status and the decoded body of a response."""

    status: int
    content: Any


class Transport:
    """The application, ready for requests."""

    def __init__(self) -> None:
        self._application = WSGIHandler()

    def send(
        self,
        method: str,
        path: str,
        document: Any = None,
        token: str = "",
        address: str = THIS_MACHINE,
        **headers: str,
    ) -> Response:
        """The response to `document` from `address`, by the participant or device of `token`.

        `headers` are named as in WSGI: HTTP_IDEMPOTENCY_KEY.
        """
        status: list[str] = []
        where, _, query = path.partition("?")
        body = b"" if document is None else json.dumps(document).encode()
        environment = {
            "REQUEST_METHOD": method, "PATH_INFO": f"{API}{where}", "QUERY_STRING": query,
            "SERVER_NAME": _own_host(), "SERVER_PORT": "443", "SERVER_PROTOCOL": "HTTP/1.1",
            "REMOTE_ADDR": address, "CONTENT_TYPE": "application/json", "CONTENT_LENGTH": str(len(body)),
            "wsgi.version": (1, 0), "wsgi.url_scheme": "https", "wsgi.input": io.BytesIO(body),
            "wsgi.errors": io.StringIO(), "wsgi.multithread": False, "wsgi.multiprocess": True,
            "wsgi.run_once": False, **headers,
        }  # fmt: skip
        if token:
            environment["HTTP_AUTHORIZATION"] = f"Bearer {token}"

        def start_response(line: str, *_: object) -> Callable[[bytes], object]:
            status.append(line)
            return io.BytesIO().write

        with _same_connection():
            response = self._application(environment, start_response)
            content = b"".join(response)
            response.close()
        return Response(int(status[0].split()[0]), json.loads(content) if content else None)

    def ask(self, wanted: int, method: str, path: str, **more: Any) -> Any:
        """The content of the response. Raises RefusedError if its status is not `wanted`."""
        response = self.send(method, path, **more)
        if response.status == wanted:
            return response.content
        problem: Mapping[str, Any] = response.content or {}
        raise RefusedError(f"{problem.get('code', response.status)}: {problem.get('detail', 'no details')}")


@contextmanager
def _same_connection() -> Iterator[None]:
    """A request must not close the connection to the database: its caller may be in a transaction."""
    signals = (request_started, request_finished)
    for signal in signals:
        signal.disconnect(close_old_connections)
    try:
        yield
    finally:
        for signal in signals:
            signal.connect(close_old_connections)


def _own_host() -> str:
    """A host name that this deployment serves."""
    named = [host for host in (*settings.PUBLIC_HOSTS, *settings.ALLOWED_HOSTS) if host != "*"]
    return named[0].lstrip(".") if named else "localhost"
