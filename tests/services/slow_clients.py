"""Clients that send or read next to nothing, many at once, and others who ask meanwhile."""

import http.client
import json
import socket
import ssl
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

SMALLEST_BUFFER = 4096
PATIENCE_SECONDS = 60.0
# Clients of one address; deploy/nginx.conf allows more.
OF_ONE_ADDRESS = 50


@dataclass(frozen=True)
class Address:
    """Where a server is reached, as `host` at a `port` of this machine; with a `tls` context, over `tls`."""

    port: int
    host: str = "127.0.0.1"
    tls: ssl.SSLContext | None = None

    def connect(self, source: str = "127.0.0.1", buffer: int | None = None) -> socket.socket:
        """A connection from `source`, with a receive buffer of `buffer` bytes."""
        plain = socket.socket()
        plain.settimeout(PATIENCE_SECONDS)
        if buffer is not None:
            plain.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
        plain.bind((source, 0))
        plain.connect(("127.0.0.1", self.port))
        if self.tls is None:
            return plain
        return self.tls.wrap_socket(plain, server_hostname=self.host)

    def ask(self, method: str, path: str, body: Any = None, **headers: str) -> "Answered":
        """One request on a connection of its own."""
        connection = http.client.HTTPConnection(self.host, self.port, timeout=PATIENCE_SECONDS)
        with self.connect() as connection.sock:
            connection.request(method, path, body, headers)
            response = connection.getresponse()
            content = response.read()
        return Answered(response.status, response.headers, content)

    def half_open(self, source: str = "127.0.0.1") -> socket.socket:
        """An upload that stops after one byte of its body."""
        line = self.connect(source)
        head = f"POST /api/v1/submissions HTTP/1.1\r\nHost: {self.host}\r\nContent-Length: 1000\r\n"
        line.sendall(f"{head}Content-Type: application/json\r\n\r\n{{".encode())
        return line

    def slow_reader(self, path: str, source: str = "127.0.0.1") -> socket.socket:
        """A download of `path` whose reader stops after the first bytes."""
        line = self.connect(source, SMALLEST_BUFFER)
        line.sendall(f"GET {path} HTTP/1.1\r\nHost: {self.host}\r\n\r\n".encode())
        first = line.recv(12)
        assert first.endswith(b" 200"), first
        return line


@dataclass(frozen=True)
class Answered:
    """An answer."""

    status: int
    headers: Any
    content: bytes

    @property
    def document(self) -> Any:
        return json.loads(self.content)


@contextmanager
def crowd(address: Address, half_open: int, slow_readers: int, paths: list[str]) -> Iterator[None]:
    """So many clients of each kind, connected while the with statement lasts."""
    with ExitStack() as stack:
        for number in range(half_open):
            stack.enter_context(address.half_open(_source(number)))
        for number in range(slow_readers):
            path = paths[number % len(paths)]
            stack.enter_context(address.slow_reader(path, _source(half_open + number)))
        yield


def _source(number: int) -> str:
    """An address of this machine that few of the clients share."""
    return f"127.0.1.{1 + number // OF_ONE_ADDRESS}"
