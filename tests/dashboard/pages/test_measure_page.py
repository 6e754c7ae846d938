"""The page that measures in a browser, and the files of its client."""

from pathlib import Path
from typing import Any

import pytest
from django.test import Client

from crowd.http.middleware import _is_page
from groundwork import __version__

ISOLATION = {
    "Cross-Origin-Embedder-Policy": "require-corp",
    "Cross-Origin-Opener-Policy": "same-origin",
}


@pytest.fixture
def folder(settings: Any, tmp_path: Path) -> Path:
    """A client of the browser, with something beside it that is not served."""
    web = tmp_path / "web"
    web.mkdir()
    settings.FRONTRUNNER_WEB_CLIENT = web
    (tmp_path / "secret.js").write_text("secret")
    (web / "worker.js").write_text("export {};\n" * 100)
    (web / "jsconfig.json").write_text("{}")
    (web / "globals.d.ts").write_text("")
    (web / "inner.js").mkdir()
    return web


def test_the_navigation_leads_to_the_page_which_says_its_version_and_is_isolated(
    client: Client, db: None
) -> None:
    response = client.get("/measure/")

    page = response.content.decode()
    assert '<a href="/measure/">Measure</a>' in client.get("/about/").content.decode()
    assert '<a href="/measure/" aria-current="page">' in page
    assert f'data-version="{__version__}"' in page
    assert {name: response.headers[name] for name in ISOLATION} == ISOLATION
    assert response.headers["Cache-Control"] == "no-cache"


def script_sources(client: Client, address: str) -> str:
    policy = client.get(address).headers["Content-Security-Policy"]
    return next(part.strip() for part in policy.split(";") if part.strip().startswith("script-src "))


@pytest.mark.parametrize("address", ["/measure/", "/measure/worker.js"])
def test_the_page_and_its_workers_may_compile_webassembly(
    client: Client, folder: Path, db: None, address: str
) -> None:
    assert script_sources(client, address) == "script-src 'self' 'wasm-unsafe-eval'"


def test_an_unchanged_worker_keeps_its_policy(client: Client, folder: Path) -> None:
    tag = client.get("/measure/worker.js").headers["ETag"]
    same = client.get("/measure/worker.js", headers={"If-None-Match": tag})

    assert same.status_code == 304
    assert "'wasm-unsafe-eval'" in same.headers["Content-Security-Policy"]


@pytest.mark.parametrize(
    "address", ["/", "/about/", "/devices/", "/fronts/", "/guide/", "/admin/", "/measure/none.js"]
)
def test_no_other_page_may_compile_webassembly_or_is_isolated(client: Client, db: None, address: str) -> None:
    assert script_sources(client, address) == "script-src 'self'"
    assert "Cross-Origin-Embedder-Policy" not in client.get(address).headers


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("a.js", "text/javascript; charset=utf-8"),
        ("a.css", "text/css; charset=utf-8"),
        ("a.svg", "image/svg+xml"),
        ("icon-192.png", "image/png"),
        ("app.webmanifest", "application/manifest+json"),
    ],
)
def test_a_file_is_served_as_what_it_is(client: Client, folder: Path, name: str, kind: str) -> None:
    (folder / name).write_bytes(b"content")

    response = client.get(f"/measure/{name}")

    assert response.content == b"content"
    assert response.headers["Content-Type"] == kind
    assert response.headers["X-Content-Type-Options"] == "nosniff"
    assert {header: response.headers[header] for header in ISOLATION} == ISOLATION


def test_an_unchanged_file_answers_304_and_a_changed_one_is_sent(client: Client, folder: Path) -> None:
    first = client.get("/measure/worker.js", headers={"Accept-Encoding": "gzip"})
    same = client.get("/measure/worker.js", headers={"If-None-Match": first.headers["ETag"]})
    (folder / "worker.js").write_text("export const changed = 1;")
    changed = client.get("/measure/worker.js", headers={"If-None-Match": first.headers["ETag"]})

    assert first.headers["Cache-Control"] == "no-cache"
    assert first.headers["Content-Encoding"] == "gzip"
    assert (same.status_code, same.content) == (304, b"")
    assert same.headers["Cross-Origin-Embedder-Policy"] == "require-corp"
    assert (changed.status_code, changed.content) == (200, b"export const changed = 1;")


def test_a_file_can_be_asked_about_and_not_written(client: Client, folder: Path) -> None:
    asked = client.head("/measure/worker.js")

    assert (asked.status_code, asked.content) == (200, b"")
    assert client.post("/measure/worker.js").status_code == 405


@pytest.mark.parametrize(
    "name",
    [
        "missing.js",
        "jsconfig.json",
        "globals.d.ts",
        "inner.js",
        "../secret.js",
        "..%2Fsecret.js",
        "%2e%2e/secret.js",
        "..\\secret.js",
        ".js",
        "worker.js/",
        "worker.js%0A",
        "WORKER.JS",
    ],
)
def test_nothing_else_is_served(client: Client, folder: Path, db: None, name: str) -> None:
    assert client.get(f"/measure/{name}").status_code == 404


def test_each_module_of_the_client_is_served(client: Client, db: None, settings: Any) -> None:
    for path in Path(settings.FRONTRUNNER_WEB_CLIENT).glob("*.js"):
        assert client.get(f"/measure/{path.name}").content == path.read_bytes()


def test_files_do_not_count_as_pages_and_the_page_does() -> None:
    assert _is_page("/measure/")
    assert not _is_page("/measure/worker.js")
