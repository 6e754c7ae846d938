"""`manage.py serve` as its user starts and ends it."""

import gzip
import http.client
import json
import socket
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.services.program import free_port
from tests.services.serving import Serving, command, shell
from tests.waiting import until


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    """One of the embedded default."""
    with Serving(tmp_path_factory.mktemp("served") / "var", {}) as running:
        yield running


def test_a_taken_port_is_one_clear_line(tmp_path: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        done = command(tmp_path / "var", "serve", FRONTRUNNER_PORT=str(port))

    assert done.returncode == 1
    (line,) = done.stderr.strip().splitlines()
    assert f"port {port}" in line
    assert "PORT=" in line


def test_a_start_imports_nothing_that_only_some_tasks_need(tmp_path: Path) -> None:
    heavy = ["scipy.stats", "sklearn", "pandas", "pyarrow", "plotly", "cv2"]

    found = shell(tmp_path, f"import sys; print([name for name in {heavy} if name in sys.modules])")

    assert found == "[]\n"  # each takes a second, in every process of a server and in every command


def test_a_folder_that_is_served_already_is_one_clear_line(server: Serving) -> None:
    done = command(server.var, "serve", FRONTRUNNER_PORT=str(free_port()))

    assert done.returncode == 1
    (line,) = done.stderr.strip().splitlines()
    assert str(server.var) in line
    assert f"process {server.process.pid}" in line
    assert "DATA=" in line


def test_ctrl_c_ends_everything_and_a_second_start_keeps_the_data(tmp_path: Path) -> None:
    var = tmp_path / "var"
    with Serving(var, {}) as server:
        children = server.pids()
        assert len(children) == 3
        first = server.said()
        token = server.enrol()
    assert server.process.returncode == 0
    assert server.pids() == []
    assert "password" in first

    with Serving(var, {}) as again:
        assert "password" not in again.said()
        status, _ = again.call("GET", "/api/v1/me/data", Authorization=f"Bearer {token}")
        assert status == 200


def test_bodies_beyond_the_limits_are_refused_over_the_wire(server: Serving) -> None:
    headers = {
        "Authorization": f"Bearer {server.enrol()}",
        "Idempotency-Key": "a",
        "Content-Type": "application/json",
    }

    def refusal(body: Any, **more: str) -> tuple[int, str]:
        connection = http.client.HTTPConnection("127.0.0.1", server.port)
        connection.request("POST", "/api/v1/submissions", body, headers | more)
        response = connection.getresponse()
        assert response.headers["Content-Type"] == "application/problem+json"
        return response.status, json.loads(response.read())["code"]

    assert refusal(b" " * (2 << 20)) == (413, "body_too_large")
    bomb = gzip.compress(b" " * (64 << 20))
    assert refusal(bomb, **{"Content-Encoding": "gzip"}) == (413, "inflated_too_large")
    # Without a length: http.client sends what it iterates over in chunks.
    assert refusal(iter([b" " * (1 << 20), b" "])) == (413, "body_too_large")


def test_a_body_in_chunks_is_read(server: Serving) -> None:
    wish = json.dumps({"app": "test", "app_version": "0.1.0", "consent_version": 2}).encode()
    connection = http.client.HTTPConnection("127.0.0.1", server.port)
    connection.request(
        "POST", "/api/v1/enrol", iter([wish[:9], wish[9:]]), {"Content-Type": "application/json"}
    )

    assert connection.getresponse().status == 201


def test_pages_and_compressed_static_files_are_served(server: Serving) -> None:
    with urllib.request.urlopen(f"{server.url}/") as response:
        page = response.read().decode()
    style = page.split('rel="stylesheet" href="')[1].split('"')[0]
    request = urllib.request.Request(f"{server.url}{style}", headers={"Accept-Encoding": "gzip"})
    with urllib.request.urlopen(request) as response:
        assert response.headers["Content-Encoding"] == "gzip"
        assert "immutable" in response.headers["Cache-Control"]
    status, state = server.call("GET", "/readyz")
    assert (status, state["database"], state["broker"]) == (200, "ok", "ok")
    assert until(
        lambda: (
            json.loads(json.dumps(server.call("GET", "/readyz")[1]))["seconds_since_last_task"] is not None
        )
    )
