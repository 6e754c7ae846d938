"""Serves the browser's modules and what they read, cross-origin isolated as the measuring page is."""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

WEB = Path(__file__).resolve().parents[3] / "client_kit" / "web"
TYPES = {".js": "text/javascript", ".json": "application/json", ".wasm": "application/wasm"}


def measurement_at_any_speed(most_slower: str = "Infinity") -> str:
    """measurement.js, which calls no run disturbed, however busy this machine is; with "0", every run."""
    text = (WEB / "measurement.js").read_text(encoding="utf-8")
    [limit] = re.findall(r"^const MOST_SLOWER = .*;$", text, re.MULTILINE)
    return text.replace(limit, f"const MOST_SLOWER = {most_slower};")


class WebServer(ThreadingHTTPServer):
    """/measure/ is client_kit/web; `documents` has the bytes of other paths, `folders` the place of more.

    Any other path is an empty page.
    """

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.documents: dict[str, bytes] = {}
        self.folders: dict[str, Path] = {"/measure/": WEB}

    @property
    def url(self) -> str:
        """localhost is a secure context, which WebGPU needs."""
        return f"http://localhost:{self.server_port}"

    def content(self, path: str) -> bytes:
        """What a path answers."""
        if path in self.documents:
            return self.documents[path]
        for prefix, folder in self.folders.items():
            if path.startswith(prefix):
                return (folder / path.removeprefix(prefix)).read_bytes()
        return b"<!doctype html><title>Modules</title>"


class _Handler(BaseHTTPRequestHandler):
    server: WebServer

    def do_GET(self) -> None:
        try:
            body = self.server.content(self.path)
        except OSError:
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Type", TYPES.get(Path(self.path).suffix, "text/html"))
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cross-Origin-Opener-Policy", "same-origin")
        self.send_header("Cross-Origin-Embedder-Policy", "require-corp")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""


@contextmanager
def served() -> Iterator[WebServer]:
    """A running server."""
    server = WebServer()
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def evaluated(page: Any, function: str, argument: object) -> Any:
    """What `function` gives for `argument` on `page`; as JSON, which Playwright hands over faster than
    values."""
    return page.evaluate(f"(text) => ({function})(JSON.parse(text))", json.dumps(argument))
