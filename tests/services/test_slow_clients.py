"""Slow clients cost the others nothing: with `manage.py serve` alone, behind nginx and behind Caddy."""

import gzip
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.services import intake, slow_clients
from tests.services.intake import LIMITS
from tests.services.proxies import HOST, Caddy, Nginx, running
from tests.services.serving import Serving, shell
from tests.services.slow_clients import Address
from tests.services.strangers import ENROLMENT
from tests.waiting import until

HALF_OPEN, SLOW_READERS = 200, 50
# Slow clients are dropped only long after PATIENCE_SECONDS: a server that waits for them never answers.
PATIENT = {"DJANGO_SETTINGS_MODULE": "tests.services.body_seconds", "TEST_BODY_SECONDS": "600"}
TOLERANT = LIMITS | PATIENT
LARGE_BYTES = 64 << 20
CHUNK, EXPORT = f"/sequences/{'f' * 64}", "/data/latest/runs.parquet"
JSON = {"Content-Type": "application/json"}
PUBLISH = f"""
import os
from crowd.results.opendata import exports
from crowd.results.opendata.storing import storage
export = exports.create_export()
stored = export.files.get(name="runs.parquet").stored
os.truncate(storage().path(stored.stored_as), {LARGE_BYTES})
stored.bytes = {LARGE_BYTES}
stored.save()
"""


def prepare(var: Path) -> None:
    """A data folder with a front and a large chunk of a sequence."""
    intake.prepare(var, {})
    chunk = next((var / "sequences").glob("*/chunks")) / CHUNK.rpartition("/")[2]
    with chunk.open("wb") as file:
        file.truncate(LARGE_BYTES)


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with a large file of open data besides."""
    var = tmp_path_factory.mktemp("slow") / "var"
    prepare(var)
    shell(var, PUBLISH)
    return var


@pytest.fixture(scope="module")
def behind_proxies(prepared: Path) -> Iterator[Serving]:
    """A server with a public name."""
    with Serving(prepared, TOLERANT | {"FRONTRUNNER_HOSTS": HOST}) as server:
        yield server


@pytest.fixture(params=["alone", "nginx", "caddy"], scope="module")
def address(
    request: pytest.FixtureRequest, prepared: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Address]:
    """Where a server is reached: itself, or a proxy of deploy/ in front of it."""
    if request.param == "alone":
        with Serving(prepared, TOLERANT) as server:
            yield Address(server.port)
        return
    server: Serving = request.getfixturevalue("behind_proxies")
    kind = {"nginx": Nginx, "caddy": Caddy}[request.param]
    with running(kind, tmp_path_factory.mktemp(request.param) / "proxy", server.port) as proxy:
        address = Address(proxy.port, HOST, proxy.context())
        until(lambda: address.ask("GET", "/healthz").status == 200)
        yield address


def test_slow_clients_hold_nobody_up(address: Address) -> None:
    with slow_clients.crowd(address, HALF_OPEN, SLOW_READERS, [CHUNK, EXPORT]):
        answers = [
            address.ask("GET", "/healthz"),
            address.ask("GET", "/api/v1/manifest"),
            address.ask("POST", "/api/v1/enrol", json.dumps(ENROLMENT), **JSON),
            address.ask("GET", CHUNK),
        ]

    assert [answer.status for answer in answers] == [200, 200, 201, 200]
    assert len(answers[-1].content) == LARGE_BYTES


def test_bodies_pass_up_to_the_limits(address: Address) -> None:
    def refusal(path: str, body: Any, **headers: str) -> tuple[int, str]:
        answer = address.ask("POST", path, body, **headers)
        is_problem = answer.headers["Content-Type"] == "application/problem+json"
        return answer.status, answer.document["code"] if is_problem else ""

    largest = b" " * (1 << 20)
    # The slow clients of the test before have just left: their requests are still being ended.
    until(lambda: address.ask("GET", "/api/v1/manifest").status == 200)
    assert refusal("/api/v1/enrol", largest, **JSON) == (400, "malformed_json")
    assert refusal("/api/v1/enrol", largest + b" ", **JSON) == (413, "body_too_large")
    # http.client sends what it iterates over in chunks.
    assert refusal("/api/v1/enrol", iter([largest]), **JSON) == (400, "malformed_json")
    assert refusal("/api/v1/enrol", iter([largest, b" "]), **JSON) == (413, "body_too_large")
    # A file of a front reaches the administration, which asks for a log-in.
    form = {"Content-Type": "application/x-www-form-urlencoded"}
    assert refusal("/admin/login/", b"a" * (4 << 20), **form)[0] in {400, 403}


def test_downloads_resume(address: Address) -> None:
    part = address.ask("GET", EXPORT, Range="bytes=10-100009")

    assert (part.status, len(part.content)) == (206, 100_000)
    assert part.headers["Content-Range"].startswith("bytes 10-100009/")


def test_answers_are_compressed_and_known_ones_are_not_sent_again(address: Address) -> None:
    packed = {"Accept-Encoding": "gzip"}
    page = address.ask("GET", "/", **packed)
    style = gzip.decompress(page.content).decode().split('rel="stylesheet" href="')[1].split('"')[0]
    file = address.ask("GET", style, **packed)
    manifest = address.ask("GET", "/api/v1/manifest", **packed)
    again = address.ask("GET", "/api/v1/manifest", **packed, **{"If-None-Match": manifest.headers["ETag"]})

    assert [each.headers["Content-Encoding"] for each in (page, file)] == ["gzip", "gzip"]
    assert "immutable" in file.headers["Cache-Control"]
    assert (manifest.status, again.status, again.content) == (200, 304, b"")


def test_a_client_cannot_forge_what_a_proxy_reports(address: Address) -> None:
    forged = address.ask("GET", "/about/", **{"X-Forwarded-Proto": "http", "X-Forwarded-For": "127.0.0.1"})

    assert forged.status == 200
    assert ("Strict-Transport-Security" in forged.headers) is (address.tls is not None)


def test_monitoring_is_not_for_strangers(address: Address) -> None:
    expected = 200 if address.tls is None else 404

    assert address.ask("GET", "/metrics").status == expected
    assert address.ask("GET", "/readyz").status == expected
    assert address.ask("GET", "/healthz").status == 200


def test_a_public_server_takes_localhost_from_this_machine_alone(behind_proxies: Serving) -> None:
    public, local = Address(behind_proxies.port, HOST), Address(behind_proxies.port, "localhost")
    forwarded = {"X-Forwarded-For": "198.51.100.7", "X-Forwarded-Proto": "https"}

    for path in ("/healthz", "/readyz", "/metrics"):
        assert local.ask("GET", path).status == 200
    assert local.ask("GET", "/metrics", **forwarded).status == 400
    assert local.ask("GET", "/about/", **forwarded).status == 400
    about = public.ask("GET", "/about/", **forwarded)
    assert about.status == 200
    assert "preload" not in about.headers["Strict-Transport-Security"]


@pytest.fixture
def impatient(tmp_path: Path) -> Iterator[Serving]:
    """A server that soon drops slow clients."""
    prepare(tmp_path / "var")
    with Serving(tmp_path / "var", TOLERANT | {"TEST_BODY_SECONDS": "1"}) as server:
        yield server


def test_slow_clients_are_dropped(impatient: Serving) -> None:
    address, web = Address(impatient.port), impatient.var / "logs" / "web.log"

    with address.half_open() as upload, address.slow_reader(CHUNK) as download:
        refusal = b"".join(iter(lambda: upload.recv(1 << 16), b""))
        until(lambda: "disconnected a client" in web.read_text())
        received = sum(len(piece) for piece in iter(lambda: download.recv(1 << 16), b""))

    assert refusal.startswith(b"HTTP/1.1 408 ")
    assert b'"body_too_slow"' in refusal
    assert received < LARGE_BYTES
    assert "POST /unmatched 408" in web.read_text()
