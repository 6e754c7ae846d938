"""The guide builds strictly, works under the server's content security policy, and is served at /guide/."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from django.test import Client

from crowd.http import codes
from crowd.results.validity.rules import RULES
from groundwork import folders


def texts(guide: Path) -> Iterator[tuple[str, str]]:
    for page in sorted(guide.rglob("*.html")):
        yield str(page.relative_to(guide)), page.read_text(encoding="utf-8")


def test_no_page_has_what_the_content_security_policy_forbids(guide: Path) -> None:
    pages = dict(texts(guide))

    assert {"index.html", "search.html", "reference/commands.html"} <= pages.keys()
    for name, text in pages.items():
        assert re.findall(r"<script(?![^>]*\bsrc=)[^>]*>", text) == [], name
        assert "<style" not in text, name
        assert re.findall(r"<\w+[^>]*\son\w+=", text) == [], name
        assert re.findall(r'(?:src|<link[^>]* href)="(?:https?:)?//', text) == [], name


def test_the_search_finds_words_of_the_pages(guide: Path) -> None:
    index = (guide / "searchindex.js").read_text(encoding="utf-8")

    assert index.startswith("Search.setIndex(")
    assert "hypervolum" in index
    assert "smac" not in index.lower()  # a word of research alone


def test_the_reference_has_every_command(guide: Path) -> None:
    page = (guide / "reference" / "commands.html").read_text(encoding="utf-8")

    for command in (
        "measure run",
        "tune explore",
        "slam datasets make",
        "admin front publish",
        "serve",
        "admin backup",
    ):
        assert f"frontrunner {command}" in page


def test_the_guide_has_every_code_and_every_rule(guide: Path) -> None:
    api = (guide / "data" / "api.html").read_text(encoding="utf-8")
    statistics = (guide / "results" / "statistics.html").read_text(encoding="utf-8")

    for code in codes.CODES:
        assert f">{code}</span>" in api, code
    for rule in RULES.values():
        assert f">{rule.code}</span>" in statistics, rule.code


def test_screen_readers_can_tell_the_parts_of_a_page_apart(guide: Path) -> None:
    for name, text in texts(guide):
        asides = re.findall(r"<aside\b([^>]*)", text)
        assert len({re.findall(r'aria-label="([^"]+)"', aside)[0] for aside in asides}) == len(asides), name
        assert all("aria-level=" in heading for heading in re.findall(r'<[^>]*role="heading"[^>]*', text)), (
            name
        )
        assert text.count("<h1>") == 1, name


def test_every_page_leads_back_to_the_site(guide: Path) -> None:
    for name, text in texts(guide):
        up = "../" * name.count("/") or "./"
        assert f'<a class="sidebar-site" href="{up}../">' in text, name


@pytest.mark.slow
@pytest.mark.django_db
def test_a_server_shows_the_guide(guide: Path, monkeypatch: pytest.MonkeyPatch, client: Client) -> None:
    monkeypatch.setattr(folders, "GUIDE", guide)

    first = client.get("/guide/")
    style = client.get("/guide/_static/guide.css")
    again = client.get("/guide/", headers={"if-modified-since": first["Last-Modified"]})

    assert first.status_code == 200
    assert b"Frontrunner" in b"".join(first.streaming_content)
    assert "script-src 'self'" in first["Content-Security-Policy"]
    assert (style.status_code, style["Content-Type"]) == (200, "text/css")
    assert again.status_code == 304
    assert client.get("/guide/nowhere.html").status_code == 404
    assert client.get("/guide/../folders.py").status_code == 400


@pytest.mark.django_db
def test_a_server_without_the_guide_says_how_to_build_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, client: Client
) -> None:
    monkeypatch.setattr(folders, "GUIDE", tmp_path / "guide")

    for address in ("/guide/", "/guide/take-part.html"):
        answer: Any = client.get(address)
        assert answer.status_code == 200
        assert "make docs" in answer.content.decode()
