"""An honest crowd, and one attacker who sends all that one address may send in an hour.

Six device models with three installations each gain 2.0x. The limits are those of a public server.
"""

import gzip
import io
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import unescape
from typing import Any

import pyarrow.parquet
import pytest

from tests.services.browser import Browser
from tests.services.program import until
from tests.services.serving import Serving, shell
from tests.services.strangers import (
    MODELS,
    READER,
    SPEEDUP,
    Attacker,
    Caller,
    Document,
    database_bytes,
    honest_crowd,
    publish_front,
    words_in,
)

SERVICES = {"FRONTRUNNER_PROXIES": "1"}
MOST_GROWTH = 50 << 20
MOST_SHIFT = 0.05
# Addresses of one kind that are read, such as pages of sessions.
MOST_OF_A_KIND = 4
LINK = re.compile(r'(?:href|src|data-[a-z-]+)="(/[^"#]*)')
SETTLE = "from crowd.results import tasks; tasks.sweep()"
EXPORT = "from crowd.results.opendata import exports; exports.create_export()"


@dataclass(frozen=True)
class Public:
    """What everybody reads at one moment, and what it takes on the disk."""

    speedups: Any
    devices: Any
    database: int

    @property
    def summary(self) -> Any:
        return self.speedups["summary"]


@dataclass(frozen=True)
class Attacked:
    """The server before and after the attack."""

    server: Serving
    attacker: Attacker
    refused_everywhere: bool
    before: Public
    after: Public


def worked_through(server: Serving, *scripts: str) -> Public:
    """What is public once no session waits, and after SCRIPTS."""
    until(lambda: server.waiting() == 0)
    shell(server.var, "; ".join((SETTLE, *scripts)), **SERVICES)
    reader = Caller(server, READER)
    return Public(
        reader.get("/api/v1/speedups?limit=1000&configuration=best"),
        reader.get("/api/v1/devices?limit=1000"),
        database_bytes(server.var),
    )


@pytest.fixture(scope="module")
def attacked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Attacked]:
    var = tmp_path_factory.mktemp("strangers") / "var"
    publish_front(var, SERVICES)
    with Serving(var, SERVICES) as server:
        honest_crowd(server)
        before = worked_through(server, EXPORT)
        attacker = Attacker(server)
        attacker.attack()
        refused = attacker.refused_everywhere()
        yield Attacked(server, attacker, refused, before, worked_through(server, EXPORT))


def test_the_attacker_used_up_every_limit(attacked: Attacked) -> None:
    assert attacked.refused_everywhere
    assert attacked.attacker.taken > 100
    assert not {status for status in attacked.attacker.caller.statuses if status >= 500}


def test_the_headline_stays_where_the_honest_put_it(attacked: Attacked) -> None:
    before, after = attacked.before.summary, attacked.after.summary

    assert before["devices"] == len(MODELS)
    assert after["low"] < SPEEDUP < after["high"]
    assert abs(after["geometric_mean"] / before["geometric_mean"] - 1) < MOST_SHIFT


def test_failures_that_one_network_reports_are_not_the_crowds(attacked: Attacked) -> None:
    before, after = attacked.before.summary, attacked.after.summary

    assert (before["attempted"], before["failing"], before["losing"]) == (len(MODELS), 0, 0)
    assert (after["failing"], after["losing"]) == (0, 0)


def test_the_database_grows_by_little(attacked: Attacked) -> None:
    assert attacked.after.database - attacked.before.database < MOST_GROWTH


def test_no_word_of_the_attacker_is_public(attacked: Attacked) -> None:
    texts = pages(attacked.server, attacked.attacker.worded) | open_data(attacked.server)

    assert words_in(texts) == []
    # The pages of devices, sessions and runs were among them.
    kinds = {kind(place) for place in texts}
    assert {"/devices/-/", "/sessions/-/", "/runs/-/", "/data/", "/about/", "/compare/", "sessions"} <= kinds


def test_an_administrator_removes_all_of_it_in_one_action(attacked: Attacked) -> None:
    server, first = attacked.server, attacked.attacker.members[0]
    browser = Browser(server)
    (password,) = re.findall(r"password (\S+)", server.said())
    browser.log_in("admin", password)
    shown = browser.get(f"/admin/devices/installation/{first.id}/change/")
    (network,) = re.findall(r">([0-9a-f]{32})<", shown)

    page = "/admin/results/tombstone/erase/"
    preview = browser.post(page, network=network, reason="made up")
    browser.post(page, network=network, reason="made up", confirm="1")

    assert f"<td>{len(attacked.attacker.members)}, erased as a whole" in preview
    left = worked_through(server)
    assert left.speedups == attacked.before.speedups
    assert left.devices == attacked.before.devices
    assert attacked.attacker.members[0].send(b"{}") == 401
    exported = {place: text for place, text in open_data(server).items() if place != "tombstones"}
    sessions = exported["sessions"]
    assert len(re.findall(r"'session': ", sessions)) == 3 * len(MODELS)


def pages(server: Serving, sessions: Sequence[Document]) -> dict[str, str]:
    """The pages of all devices and of SESSIONS, and a few of each other kind that links lead to."""
    devices = Caller(server, READER).get("/api/v1/devices?limit=1000")["results"]
    slugs = [row["slug"] for row in devices]
    every = [f"/devices/{slug}/" for slug in slugs]
    for session in sessions:
        every += [f"/sessions/{session['id']}/", *(f"/runs/{run['id']}/" for run in session["runs"][:2])]
    waiting = ["/", *every, f"/compare/?devices={','.join(slugs[:6])}", "/api/v1/devices?limit=1000"]
    waiting += [
        "/api/v1/speedups?limit=1000&configuration=all",
        *(f"/api/v1/devices/{slug}" for slug in slugs),
    ]
    found: dict[str, str] = {}
    seen: Counter[str] = Counter()
    for number, place in enumerate(waiting):
        if place in found or (seen[kind(place)] >= MOST_OF_A_KIND and place not in every):
            continue
        seen[kind(place)] += 1
        # From several addresses, each within the limit.
        status, content = Caller(server, f"198.51.100.{number // 100}").ask("GET", place)
        assert status in {200, 400}, (place, content)
        text = found[place] = content.decode(errors="replace")
        waiting += [
            link
            for link in map(unescape, LINK.findall(text))
            if not link.startswith(("/static/", "/admin/", "/data/2", "/data/latest", "/sequences/"))
            and not link.partition("?")[0].endswith(".png")
        ]
    return found


def kind(place: str) -> str:
    """The address PLACE without what differs between pages of one kind."""
    return re.sub(
        r"(?<=/)(?!figures|tables|embed|api)[a-z0-9]*[-0-9][a-z0-9-]*(?=/|$|\.)", "-", place.partition("?")[0]
    )


def open_data(server: Serving) -> dict[str, str]:
    """The newest export, file by file, as text; tables by their names."""
    reader = Caller(server, READER)
    found = {}
    (newest, *_) = reader.get("/api/v1/exports")["results"]
    for file in newest["files"]:
        status, content = reader.ask("GET", file["latest_url"])
        assert status == 200, (file, content)
        if file["format"] == "parquet":
            table = pyarrow.parquet.read_table(io.BytesIO(content)).to_pylist()
            found[file["table"]] = found.get(file["table"], "") + str(table)
        else:
            packed = file["name"].endswith(".gz")
            found[file["name"]] = (gzip.decompress(content) if packed else content).decode()
    return found
