"""What every figure gives besides itself: its numbers, and a page for other sites."""

import csv
import io
import json
import re
from dataclasses import replace
from html import unescape
from typing import Any

import pytest
from django.test import Client, RequestFactory
from django.urls import reverse

from crowd.dashboard.drawings import DRAWINGS
from crowd.dashboard.drawings.drawing import Drawing, Table
from crowd.dashboard.drawings.serving import render_csv, render_json
from crowd.results.reading import selectors
from crowd.results.reading.queries.filters import SpeedupFilters
from tests.builders import searches


def test_every_drawing_has_addresses_of_its_own() -> None:
    assert len({drawing.name for drawing in DRAWINGS}) == len({drawing.path for drawing in DRAWINGS})
    assert len({drawing.name for drawing in DRAWINGS}) == len(DRAWINGS)


def drawing_of(rows: list[tuple[Any, ...]]) -> Any:
    """A drawing without a figure, whose table holds `rows`."""
    return replace(
        DRAWINGS[0],
        table=lambda _: Table(("name", "time_s"), rows),
        title=lambda _: "",
        n=lambda _: "1\N{NO-BREAK SPACE}row",
    )


def test_a_spreadsheet_computes_nothing_of_what_a_client_sent() -> None:
    text = render_csv(RequestFactory().get("/"), drawing_of([("=1+1", 0.5), ("plain", -1.0)]), None, {})

    assert text.splitlines() == ["name,time_s", "'=1+1,0.5", "plain,-1.0"]


def test_what_is_no_number_is_absent() -> None:
    rows = [("a", float("nan")), ("b", float("inf")), ("c", None)]
    request = RequestFactory().get("/?gpu=mali&theme=dark")

    document = json.loads(render_json(request, drawing_of(rows), None, {}))

    assert [row["time_s"] for row in document["rows"]] == [None, None, None]
    assert (document["n"], document["filters"]) == ("1 row", {"gpu": "mali"})
    assert document["page"] == "http://testserver/devices/?gpu=mali"


@pytest.mark.django_db
def test_every_figure_gives_its_numbers_and_a_page_to_embed(
    client: Client, session: dict[str, Any], pack: dict[str, Any]
) -> None:
    search = searches.exploration(pack)
    searches.measure(search, searches.KNOWN)
    values = {"key": search.pk, "objective": "runtime", "by": "vendor", "slug": "google-pixel-8"}
    values |= {"uuid": session["id"], "run": session["runs"][0]["id"]}

    for drawing in DRAWINGS:
        table, document, embed = asked(client, drawing, values)
        lines = list(csv.DictReader(io.StringIO(table.content.decode())))
        page = embed.content.decode().replace("\N{NO-BREAK SPACE}", " ")
        assert len(lines) == len(document["rows"]), drawing.name
        assert all(list(line) == document["columns"] for line in lines), drawing.name
        assert document["definition"] == drawing.definition_of_table, drawing.name
        assert document["simulated"] is False, drawing.name
        assert document["licence"]["name"] == "CC-BY-4.0"
        assert 'data-figure="/figures/' in page, drawing.name
        assert document["n"], drawing.name
        assert document["n"] in page, drawing.name
        assert drawing.definition in unescape(page), drawing.name
        assert "imulated" not in page, drawing.name
        assert "frame-ancestors *;" in embed["Content-Security-Policy"] + ";"
        assert "X-Frame-Options" not in embed
        assert not embed.cookies
    assert "frame-ancestors 'none'" in client.get("/")["Content-Security-Policy"]


def asked(client: Client, drawing: Drawing[Any], values: dict[str, Any]) -> tuple[Any, Any, Any]:
    """`drawing`'s numbers as CSV and as JSON, and its page to embed."""
    if drawing.name.startswith("front"):
        values = values | {"slug": "kfusion-test"}
    if drawing.name.startswith("run"):
        values = values | {"uuid": values["run"]}
    query = "device=google-pixel-8&configurations=default,best" if drawing.name == "compare" else ""
    needed = {name: values[name] for name in re.findall(r"<\w+:(\w+)>", drawing.path)}
    table, document, embed = (
        client.get(reverse(f"dashboard:{drawing.name}-{kind}", kwargs=needed) + f"?{query}")
        for kind in ("csv", "json", "embed")
    )
    assert (table.status_code, document.status_code, embed.status_code) == (200, 200, 200), drawing.name
    return table, document.json(), embed


@pytest.mark.django_db
@pytest.mark.usefixtures("session")
def test_numbers_are_those_that_the_page_shows_under_its_filters(client: Client) -> None:
    (shown,) = selectors.speedups(SpeedupFilters()).rows

    (row,) = client.get("/tables/speedups.json?vendor=Mali").json()["rows"]

    assert (row["speedup"], row["sessions"]) == (shown.speedup, shown.sessions)
    assert (row["state"], row["suspect"]) == ("confirmed", False)
    assert client.get("/tables/speedups.json?vendor=Adreno").json()["rows"] == []
    assert client.get("/tables/speedups.csv?since=never").status_code == 400


@pytest.mark.django_db
@pytest.mark.usefixtures("session")
@pytest.mark.parametrize("path", ["transfer/best", "transfer/winners", "transfer/correlation", "speedups"])
def test_what_leaves_a_page_tells_its_filters(client: Client, path: str) -> None:
    under = "?vendor=Adreno"
    document = client.get(f"/tables/{path}.json{under}").json()
    embed = client.get(f"/embed/{path}/{under}").content.decode()

    assert document["title"].endswith("front kfusion-test, Qualcomm Adreno")
    assert document["title"].partition(", ")[2] in embed
    assert "<h1>No " in embed
