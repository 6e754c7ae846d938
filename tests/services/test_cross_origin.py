"""A notebook in a browser reads one column of the open data, from another origin, through shipped proxies."""

import base64
import http.server
import io
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet
import pytest

from tests.browser.chromium import NoBrowserError, launched
from tests.builders.documents import submission_document
from tests.services import intake
from tests.services.intake import LIMITS
from tests.services.proxies import HOST, Caddy, Nginx, Proxy, running
from tests.services.serving import Serving, shell
from tests.services.slow_clients import Address
from tests.waiting import until

pytestmark = pytest.mark.slow
EXPORT = "/data/latest/runs.parquet"
ORIGIN = "https://notebook.example"
FETCH = """async ([address, range]) => {
    const answer = await fetch(address, range ? {headers: {Range: range}} : {method: "HEAD"});
    const bytes = new Uint8Array(await answer.arrayBuffer());
    return {
        status: answer.status,
        range: answer.headers.get("Content-Range"),
        length: answer.headers.get("Content-Length"),
        etag: answer.headers.get("ETag"),
        content: btoa(String.fromCharCode(...bytes)),
    };
}"""


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    """A server with a public name and an export of one session."""
    var = tmp_path_factory.mktemp("notebook") / "var"
    intake.prepare(var, {})
    with Serving(var, LIMITS) as private:
        private.submit_until_accepted(private.enrol(), submission_document())
        until(lambda: private.waiting() == 0)
    shell(var, "from crowd.results.opendata import exports; exports.create_export()", **LIMITS)
    with Serving(var, LIMITS | {"FRONTRUNNER_HOSTS": HOST}) as server:
        yield server


@pytest.fixture(params=[Nginx, Caddy], ids=["nginx", "caddy"])
def proxy(request: pytest.FixtureRequest, server: Serving, tmp_path: Path) -> Iterator[Proxy]:
    """A proxy of deploy/ in front of the server."""
    with running(request.param, tmp_path / "proxy", server.port) as proxy:
        yield proxy


@pytest.fixture
def origin() -> Iterator[str]:
    """The address of an empty page of another origin."""

    class Empty(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(b"<!doctype html><title>Notebook</title>")

        def log_message(self, *_: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Empty) as elsewhere:
        threading.Thread(target=elsewhere.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{elsewhere.server_port}/"
        elsewhere.shutdown()


class FetchedFile(io.RawIOBase):
    """The file at `address`, whose bytes a page fetches by ranges. `ranges`: those it asked for."""

    def __init__(self, page: Any, address: str) -> None:
        self.page, self.address = page, address
        self.ranges: list[str] = []
        head = page.evaluate(FETCH, [address, None])
        assert head["status"] == 200
        assert head["etag"]
        self.size, self.at = int(head["length"]), 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        self.at = offset + {io.SEEK_SET: 0, io.SEEK_CUR: self.at, io.SEEK_END: self.size}[whence]
        return self.at

    def tell(self) -> int:
        return self.at

    def read(self, size: int = -1) -> bytes:
        end = self.size if size < 0 else min(self.at + size, self.size)
        if end <= self.at:
            return b""
        self.ranges.append(f"bytes={self.at}-{end - 1}")
        answer = self.page.evaluate(FETCH, [self.address, self.ranges[-1]])
        assert answer["status"] == 206
        assert answer["range"] == f"bytes {self.at}-{end - 1}/{self.size}"
        self.at = end
        return base64.b64decode(answer["content"])


def read_column(file: FetchedFile, name: str) -> list[Any]:
    """One column of a Parquet file. A page can be asked by one thread only."""
    parquet = pyarrow.parquet.ParquetFile(file, pre_buffer=False)
    values: list[Any] = parquet.read(columns=[name], use_threads=False).column(name).to_pylist()
    return values


def test_a_page_elsewhere_reads_a_column(server: Serving, proxy: Proxy, origin: str) -> None:
    address = f"https://{HOST}:{proxy.port}{EXPORT}"
    try:
        with launched(f"--host-resolver-rules=MAP {HOST} 127.0.0.1") as browser:
            page = browser.new_context(ignore_https_errors=True).new_page()
            page.goto(origin)

            file = FetchedFile(page, address)
            column = read_column(file, "order")
            own = page.evaluate(
                "address => fetch(address).then(() => 'read', () => 'refused')",
                f"https://{HOST}:{proxy.port}/api/v1/me",
            )
    except NoBrowserError as error:
        pytest.skip(str(error))

    assert column == [0, 1, 2, 3]
    assert len(file.ranges) >= 2
    assert own == "refused"


def test_a_refusal_of_the_proxy_is_readable_elsewhere(server: Serving, proxy: Proxy) -> None:
    stopped = type(proxy)(proxy.folder.parent / "alone", 1)  # nothing listens at port 1
    with stopped:
        address = Address(stopped.port, HOST, stopped.context())
        shared, own = (address.ask("GET", path, Origin=ORIGIN) for path in (EXPORT, "/api/v1/me"))

    assert shared.status >= 500
    assert shared.headers["Access-Control-Allow-Origin"] == "*"
    assert own.headers["Access-Control-Allow-Origin"] is None


def test_too_many_connections_are_refused_readably(server: Serving, tmp_path: Path) -> None:
    class Narrow(Nginx):
        def configure(self) -> None:
            super().configure()
            file = self.folder / "frontrunner.conf"
            file.write_text(
                file.read_text().replace("limit_conn frontrunner 100;", "limit_conn frontrunner 1;")
            )

    with running(Narrow, tmp_path / "proxy", server.port) as proxy:
        address = Address(proxy.port, HOST, proxy.context())
        with address.half_open():
            until(lambda: address.ask("GET", "/data/").status == 429)
            answer = address.ask("GET", EXPORT, Origin=ORIGIN)

    assert answer.headers.get_all("Access-Control-Allow-Origin") == ["*"]
    assert answer.headers["Retry-After"] == "5"
