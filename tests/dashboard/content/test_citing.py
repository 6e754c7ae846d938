"""How pages are cited: as text, as BibTeX, with the version of the open data."""

import hashlib
import re
from datetime import date
from html import unescape
from typing import Any
from urllib.parse import unquote

import pytest
from django.core.cache import cache
from django.test import Client

from crowd.dashboard.content.citation import Citation, Version, source, tex, verbatim
from crowd.fronts.models import FrontVersion
from crowd.results.opendata import exports
from tests.builders.measuring import measure
from tests.builders.participant import Participant

DAY = date(2026, 11, 25)
VERSION = Version("2026-11-24", "0123456789abcdef" * 4)
NASTY = r"50% of {phones} & PCs_with #1 \ $5 ~ ^ Größe 小米"


def citation(**changes: Any) -> Citation:
    fields: dict[str, Any] = {"title": "Devices", "url": "https://f.example/devices/", "day": DAY}
    return Citation(**(fields | {"version": VERSION} | changes))


def parsed(bibtex: str) -> tuple[str, dict[str, str]]:
    """Key and fields of one @misc entry, read as BibTeX does: a field ends where its braces balance."""
    head = re.match(r"@misc\{([^\s,{}\"#%'()=]+),\s*", bibtex)
    assert head, bibtex
    at, fields = head.end(), {}
    while bibtex[at] != "}":
        name = re.compile(r"(\w+) = \{").match(bibtex, at)
        assert name, bibtex[at:]
        start = at = name.end()
        depth = 1
        while depth:
            depth += {"{": 1, "}": -1}.get(bibtex[at], 0)
            at += 1
        fields[name[1]] = bibtex[start : at - 1]
        end = re.compile(r",\s*").match(bibtex, at)
        assert end, bibtex[at:]
        at = end.end()
    assert bibtex[at:] == "}\n"
    return head[1], fields


def printed(field: str) -> str:
    """What TeX prints for `field`."""
    for command, letter in ((r"\textasciitilde{}", "~"), (r"\textasciicircum{}", "^")):
        field = field.replace(command, letter)
    backslash = field.replace(r"\textbackslash{}", "\0")
    assert not re.search(r"(?<!\\)[&%$#_]", backslash), field
    return re.sub(r"\\([&%$#_{}])", r"\1", backslash).replace("\0", "\\")


def test_an_entry_has_what_a_reader_needs_to_find_the_data_again() -> None:
    key, fields = parsed(citation(front="f" * 64).bibtex)

    assert key == "frontrunner-2026-devices"
    assert fields["title"] == "{Devices}"
    assert (fields["year"], fields["urldate"]) == ("2026", "2026-11-25")
    assert fields["url"] == "https://f.example/devices/"
    assert (fields["version"], fields["sha256"]) == (VERSION.day, VERSION.digest)
    note = printed(fields["note"])
    for part in (
        "Release 2026-11-24 of the open data",
        "0123456789ab;",
        "f" * 12,
        "CC-BY-4.0",
        "accessed 2026-11-25",
    ):
        assert part in note
    assert fields["author"] == "{Frontrunner}"


def test_what_tex_would_interpret_is_printed_as_it_is() -> None:
    _, fields = parsed(citation(title=NASTY).bibtex)

    assert fields["title"].startswith("{")
    assert printed(fields["title"][1:-1]) == NASTY
    assert tex("a\N{NARROW NO-BREAK SPACE}b\n c") == "a b c"


def test_an_address_ends_no_field() -> None:
    url = "https://f.example/devices/?gpu=%7B&device=a{b}c\\d e&x=1#y"

    _, fields = parsed(citation(url=url).bibtex)

    assert fields["url"] == verbatim(url)
    assert not set("{}\\ ") & set(fields["url"])
    assert unquote(fields["url"]) == unquote(url)


def test_pages_with_different_filters_have_different_keys() -> None:
    keys = {
        citation(url=f"https://f.example{path}").key
        for path in ("/", "/devices/", "/devices/?gpu=mali", "/devices/?gpu=adreno", "/devices/a-b_c/")
    }

    assert len(keys) == 5
    assert all(re.fullmatch(r"[a-z0-9-]+", key) for key in keys)
    assert "frontrunner-2026-home" in keys


def test_without_a_release_the_page_itself_is_cited() -> None:
    alone = citation(version=None)

    assert "No release of the open data yet, this cites the page itself" in alone.text
    assert {"version", "sha256"}.isdisjoint(parsed(alone.bibtex)[1])
    assert "no release of the open data yet" in " ".join(source("https://f.example/", DAY, None, ""))
    assert VERSION.words in " ".join(source("https://f.example/", DAY, VERSION, ""))


def shown(client: Client, address: str) -> tuple[str, str, str]:
    """The page at `address`, its citation as text, and the file that it offers."""
    page = client.get(address).content.decode()
    (text,) = re.findall(r"<p data-text>(.+?)</p>", page)
    (field,) = re.findall(r"<textarea[^>]+data-text>(.+?)</textarea>", page, re.DOTALL)
    (file,) = re.findall(
        r'href="data:application/x-bibtex;charset=utf-8,([^"]+)" download="[a-z0-9-]+\.bib"', page
    )
    assert unquote(unescape(file)).strip() == unescape(field).strip()
    return page, unescape(text), unquote(unescape(file))


@pytest.mark.django_db
def test_a_page_names_the_newest_release_and_a_digest_that_anyone_can_check(
    client: Client, participant: Participant
) -> None:
    measure(participant)
    page, text, _ = shown(client, "/devices/")
    assert "This site has no release of its" in page
    assert "No release of the open data yet" in text

    export = exports.create_export()
    measure(participant)
    exports.create_export()
    cache.clear()

    _, text, file = shown(client, "/devices/?vendor=Mali")
    package = b"".join(client.get(f"/data/{export.name}/datapackage.json"))  # type: ignore[call-overload]
    _, fields = parsed(file)
    assert fields["sha256"] == hashlib.sha256(package).hexdigest()
    assert fields["version"] == export.name
    assert f"Release {export.name} of the open data" in text
    assert fields["url"] == "http://testserver/devices/?vendor=Mali"


@pytest.mark.django_db
def test_a_citation_says_which_front_it_is_about(client: Client, front: FrontVersion) -> None:
    assert front.digest[:12] in shown(client, "/fronts/kfusion-test/")[1]


@pytest.mark.django_db
def test_a_citation_of_a_demo_says_so(client: Client, demo: None) -> None:
    assert "Simulated, not measured; no release of the open data yet" in shown(client, "/data/")[1]
