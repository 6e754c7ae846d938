"""What Sentry and a collector of traces get of a request that fails: where and why, nothing of who asked."""

import gzip
import json
import os
import subprocess
import sys
import threading
import zlib
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

# A request of the whole application for a page that fails. Programs of their own, as both change Django.
PROGRAM = """
import io
from crowd.wsgi import application
from crowd.dashboard.views import private_page

def fails(*_, **__):
    secret = "kept-in-" + "a-variable"
    raise LookupError("no such row")

private_page.own_page = fails
given = {
    "REQUEST_METHOD": "GET", "PATH_INFO": "/mine/signed-and-private/", "QUERY_STRING": "a=kept-in-the-query",
    "SERVER_NAME": "frontrunner.example", "SERVER_PORT": "443", "REMOTE_ADDR": "203.0.113.9",
    "HTTP_AUTHORIZATION": "Bearer kept-in-a-header", "HTTP_USER_AGENT": "Phone kept-in-a-header",
    "wsgi.input": io.BytesIO(), "wsgi.url_scheme": "https", "HTTP_HOST": "localhost",
}
application(given, lambda status, *_: print(status[:3]))
"""


class Receiver(BaseHTTPRequestHandler):
    """Keeps what is posted, by its path."""

    received: dict[str, bytes]

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        unpack = {"gzip": gzip.decompress, "deflate": zlib.decompress}.get(
            self.headers.get("Content-Encoding", "")
        )
        self.received[self.path] = self.received.get(self.path, b"") + (unpack(body) if unpack else body)
        self.send_response(200)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def receiver() -> Iterator[tuple[str, dict[str, bytes]]]:
    """Its host and port, and what it received."""
    Receiver.received = {}
    with ThreadingHTTPServer(("127.0.0.1", 0), Receiver) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"127.0.0.1:{server.server_address[1]}", Receiver.received
        server.shutdown()


def run(program: str, tmp_path: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"FRONTRUNNER_VAR": str(tmp_path), "DJANGO_SETTINGS_MODULE": "crowd.settings"}
    command = [sys.executable, "-c", program]
    return subprocess.run(command, env=environment | variables, capture_output=True, text=True, check=False)


def test_a_failure_is_reported_without_the_participant(
    receiver: tuple[str, dict[str, bytes]], tmp_path: Path
) -> None:
    host, received = receiver

    ended = run(
        PROGRAM, tmp_path, SENTRY_DSN=f"http://key@{host}/1", OTEL_EXPORTER_OTLP_ENDPOINT=f"http://{host}"
    )

    assert ended.stdout.strip() == "500", ended.stderr
    error, traces = received["/api/1/envelope/"], received["/v1/traces"]
    event = json.loads(error.splitlines()[2])
    assert event["exception"]["values"][0]["value"] == "no such row"
    assert event["request"] == {"method": "GET"}
    assert b"mine/" in traces
    for kept in (b"203.0.113.9", b"kept-in-", b"signed-and-private"):
        assert kept not in error
        assert kept not in traces


@pytest.mark.parametrize("variable", ["SENTRY_DSN", "OTEL_EXPORTER_OTLP_ENDPOINT"])
def test_missing_packages_are_named(variable: str, tmp_path: Path) -> None:
    missing = "import sys; sys.modules['sentry_sdk'] = sys.modules['opentelemetry'] = None\n"

    ended = run(
        missing + "import crowd.observability.reporting as r; r.start()", tmp_path, **{variable: "http://x"}
    )

    assert f"{variable} is set, but " in ended.stderr
    assert "requirements-monitoring.lock" in ended.stderr


def test_what_is_no_dsn_is_named(tmp_path: Path) -> None:
    ended = run("import crowd.observability.reporting as r; r.start()", tmp_path, SENTRY_DSN="sentry.example")

    assert "SettingError: SENTRY_DSN=sentry.example: " in ended.stderr
