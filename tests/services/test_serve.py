"""`manage.py serve` as its user starts and ends it."""

import gzip
import json
import socket
import urllib.request
from pathlib import Path
from typing import Any

from tests.services.program import free_port
from tests.services.serving import Serving, command, shell
from tests.services.slow_clients import Address
from tests.services.strangers import ENROLMENT
from tests.waiting import until

JSON = {"Content-Type": "application/json"}


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


def test_a_folder_that_is_served_already_is_one_clear_line(shared_server: Serving) -> None:
    done = command(shared_server.var, "serve", FRONTRUNNER_PORT=str(free_port()))

    assert done.returncode == 1
    (line,) = done.stderr.strip().splitlines()
    assert str(shared_server.var) in line
    assert f"process {shared_server.process.pid}" in line
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


def test_bodies_beyond_the_limits_are_refused_over_the_wire(shared_server: Serving) -> None:
    token, address = shared_server.enrol(), Address(shared_server.port)

    def refusal(body: Any, **more: str) -> tuple[int, str]:
        headers = JSON | {"Authorization": f"Bearer {token}", "Idempotency-Key": "a"} | more
        answer = address.ask("POST", "/api/v1/submissions", body, **headers)
        assert answer.headers["Content-Type"] == "application/problem+json"
        return answer.status, answer.document["code"]

    assert refusal(b" " * (2 << 20)) == (413, "body_too_large")
    bomb = gzip.compress(b" " * (64 << 20))
    assert refusal(bomb, **{"Content-Encoding": "gzip"}) == (413, "inflated_too_large")
    # Without a length: http.client sends what it iterates over in chunks.
    assert refusal(iter([b" " * (1 << 20), b" "])) == (413, "body_too_large")


def test_a_body_in_chunks_is_read(shared_server: Serving) -> None:
    wish, address = json.dumps(ENROLMENT).encode(), Address(shared_server.port)

    assert address.ask("POST", "/api/v1/enrol", iter([wish[:9], wish[9:]]), **JSON).status == 201


def test_pages_and_compressed_static_files_are_served(shared_server: Serving) -> None:
    with urllib.request.urlopen(f"{shared_server.url}/") as response:
        page = response.read().decode()
    style = page.split('rel="stylesheet" href="')[1].split('"')[0]
    request = urllib.request.Request(f"{shared_server.url}{style}", headers={"Accept-Encoding": "gzip"})
    with urllib.request.urlopen(request) as response:
        assert response.headers["Content-Encoding"] == "gzip"
        assert "immutable" in response.headers["Cache-Control"]
    status, state = shared_server.call("GET", "/readyz")
    assert (status, state["database"], state["broker"]) == (200, "ok", "ok")
    assert until(lambda: shared_server.call("GET", "/readyz")[1]["seconds_since_last_task"] is not None)
