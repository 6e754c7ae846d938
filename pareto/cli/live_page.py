"""front.html while a search is running: drawn again now and then, and served to a browser on this machine."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from groundwork import terminal
from pareto.errors import ScenarioError
from pareto.measuring.folder import EVALUATIONS, FRONT, PAGE
from pareto.search.explorer import Explorer

HOST = "127.0.0.1"
SECONDS = 30  # least time between two drawings, and between two requests of the page
SHARE = 0.05  # of the time that drawing may take
TYPES = {
    PAGE: "text/html; charset=utf-8",
    FRONT: "text/csv; charset=utf-8",
    EVALUATIONS: "text/csv; charset=utf-8",
}


class LivePage:
    """Draws `front.html` in a folder, at most every SECONDS and in at most SHARE of the time."""

    def __init__(
        self,
        explorer: Explorer,
        folder: Path,
        units: Mapping[str, str],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._explorer, self._path, self._units, self._clock = explorer, folder / PAGE, units, clock
        self._due = clock() + SECONDS

    def refresh(self) -> None:
        """Draw the page if the last drawing is old enough."""
        if self._clock() >= self._due:
            self.draw()

    def draw(self) -> None:
        """Draw the page now, and replace the old one atomically. A failure is a warning."""
        started = self._clock()
        fresh = self._path.with_name(f"{PAGE}.new")
        try:
            from pareto.plot import save  # which loads Plotly

            save(self._explorer, fresh, self._units)
            fresh.replace(self._path)
        except Exception as error:
            terminal.warn(f"{self._path} could not be drawn: {type(error).__name__}: {error}")
        ended = self._clock()
        self._due = ended + max(SECONDS, (ended - started) / SHARE)


@contextmanager
def served(folder: Path, port: int) -> Iterator[str]:
    """Serve the page and its two tables to this machine; yield the page's address. Port 0 is any free one.

    Raises ScenarioError when the port is taken.
    """
    try:
        server = ThreadingHTTPServer((HOST, port), partial(_Handler, folder))
    except OSError as error:
        raise ScenarioError(f"--serve: port {port} of {HOST} cannot be used: {error.strerror}") from error
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://{HOST}:{server.server_address[1]}/"
    finally:
        server.shutdown()
        server.server_close()


class _Handler(BaseHTTPRequestHandler):
    """Answers GET and HEAD for the files of TYPES, under names of this machine only."""

    def __init__(self, folder: Path, *arguments: object) -> None:
        self.folder = folder
        super().__init__(*arguments)  # type: ignore[arg-type]

    def do_GET(self) -> None:
        """Send a file."""
        name = self.path.split("?", 1)[0].removeprefix("/") or PAGE
        host = (self.headers.get("Host") or "").rsplit(":", 1)[0]
        # Another host name means DNS rebinding: a page from elsewhere points its name to this machine.
        if name not in TYPES or host not in (HOST, "localhost"):
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        try:
            body = (self.folder / name).read_bytes()
        except FileNotFoundError:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", TYPES[name])
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        if name == PAGE:
            self.send_header("Refresh", str(SECONDS))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    do_HEAD = do_GET  # noqa: N815 - the name is http.server's

    def log_message(self, format: str, *arguments: object) -> None:
        """Write nothing: the error output has the progress."""
