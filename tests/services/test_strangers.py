"""An honest crowd, and one attacker who sends all that one address may send in an hour.

Six device models with three installations each gain 2.0x. The limits are those of a public server. Once an
administrator has removed what the attacker sent, others attack the same server: three networks, a crowd at
one moment, a neighbour behind a shared address, a local user, a reference device.
"""

import gzip
import io
import math
import random
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from html import unescape
from pathlib import Path
from typing import Any

import pyarrow.parquet
import pytest

from crowd.results.intake import daily_limits
from tests.services import exploring, overload
from tests.services.browser import Browser
from tests.services.serving import Serving, shell
from tests.services.strangers import (
    ENROLMENT,
    INVENTED,
    MODELS,
    READER,
    SPEEDUP,
    WORD,
    Attacker,
    Board,
    Caller,
    Document,
    database_bytes,
    device,
    honest_crowd,
    invented_crowd,
    publish_front,
    session,
    submission,
    words_in,
)
from tests.waiting import until

SERVICES = {"FRONTRUNNER_PROXIES": "1"}
MOST_GROWTH = 50 << 20
MOST_SHIFT = 0.05
# Addresses of one kind that are read, such as pages of sessions.
MOST_OF_A_KIND = 4
LINK = re.compile(r'(?:href|src|data-[a-z-]+)="(/[^"#]*)')
SETTLE = "from crowd.predictions import maps; from crowd.results import tasks; tasks.sweep(); maps.rebuild()"
CHIPS = ("", "?gpu=Mali-G715", "?gpu=Adreno+740")
INVENTED_MODELS, NETWORKS = 12, 3
# More at one moment than may wait; of these, as many as may write run at once.
CROWD, HONEST, MAX_WAITING, WRITERS = 400, 200, 64, 2
EXPORT = "from crowd.results.opendata import exports; exports.create_export()"


@dataclass(frozen=True)
class Public:
    """What everybody reads at one moment, and what it takes on the disk."""

    speedups: Any
    devices: Any
    recommendations: Any
    database: int

    @property
    def summary(self) -> Any:
        return self.speedups["summary"]

    @property
    def headline(self) -> Any:
        return self.summary["headline"]


@dataclass(frozen=True)
class Attacked:
    """The server before and after the attack."""

    server: Serving
    attacker: Attacker
    refused_everywhere: bool
    before: Public
    after: Public


def worked_through(server: Serving, *scripts: str) -> Public:
    """What is public once no session waits, and after `scripts`."""
    until(lambda: server.waiting() == 0)
    shell(server.var, "; ".join((SETTLE, *scripts)), **SERVICES)
    reader = Caller(server, READER)
    return Public(
        reader.get("/api/v1/speedups?limit=1000&configuration=best"),
        reader.get("/api/v1/devices?limit=1000"),
        [reader.get(f"/api/v1/recommendation{chip}") for chip in CHIPS],
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
    before, after = attacked.before.headline, attacked.after.headline

    assert (before["models"], before["networks"]) == (len(MODELS), NETWORKS * len(MODELS))
    assert after["low"] < SPEEDUP < after["high"]
    assert abs(after["value"] / before["value"] - 1) < MOST_SHIFT


def test_what_is_recommended_stays(attacked: Attacked) -> None:
    assert_recommended_as_before(attacked.before, attacked.after)


def assert_recommended_as_before(before: Public, after: Public) -> None:
    """The same configurations, and each figure moved by less than its interval was wide."""
    for was, now in zip(before.recommendations, after.recommendations, strict=True):
        assert now["configuration"] == was["configuration"]
        ratios = {row["configuration"]: row["ratio"] for row in now["front"]}
        for row in was["front"][1:]:
            shift = abs(math.log(ratios[row["configuration"]] / row["ratio"]))
            assert shift < math.log(row["high"] / row["low"]), (row, ratios)


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
    kinds = {kind(address) for address in texts}
    assert {"/devices/-/", "/sessions/-/", "/runs/-/", "/data/", "/about/", "/compare/", "sessions"} <= kinds


def test_an_administrator_removes_all_of_it_in_one_action(attacked: Attacked) -> None:
    server, first = attacked.server, attacked.attacker.members[0]
    browser = administrator(server)
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
    exported = {name: text for name, text in open_data(server).items() if name != "tombstones"}
    sessions = exported["sessions"]
    assert len(re.findall(r"'session': ", sessions)) == 3 * len(MODELS)


def administrator(server: Serving) -> Browser:
    """The first administrator, logged in."""
    browser = Browser(server)
    (password,) = re.findall(r"password (\S+)", server.said())
    browser.log_in("admin", password)
    return browser


def test_three_networks_with_invented_models_do_not_own_the_headline(attacked: Attacked) -> None:
    server, before = attacked.server, worked_through(attacked.server)

    invented_crowd(server, INVENTED_MODELS, NETWORKS)
    after = worked_through(server)

    assert len(after.devices["results"]) == len(before.devices["results"]) + INVENTED_MODELS
    shift = math.log(after.headline["value"] / before.headline["value"])
    # Each model with a vote of its own, it would be 12 / (6 + 12).
    assert shift < NETWORKS / (len(MODELS) + NETWORKS) * math.log(INVENTED)
    assert abs(after.headline["median"] / before.headline["median"] - 1) < MOST_SHIFT
    assert_recommended_as_before(before, after)


def test_a_crowd_at_one_moment_is_refused_beyond_the_limit_and_who_left_never_runs(
    attacked: Attacked,
) -> None:
    server, reader = attacked.server, Caller(attacked.server, READER)
    chunk = next((server.var / "sequences").glob("*/chunks/*")).name
    before = overload.installations(server.var)

    with overload.locked(server.var):
        crowd = [overload.enrolling(server, f"10.9.{number}.1") for number in range(CROWD)]
        refused = overload.answers(crowd, CROWD - MAX_WAITING)
        health, download = reader.ask("GET", "/healthz"), reader.ask("GET", f"/sequences/{chunk}")
        for client in crowd:
            client.close()
        until(lambda: reader.ask("GET", "/api/v1/manifest")[0] == 200)
    assert Caller(server, "10.8.0.1").enrol() is not None

    assert [health[0], download[0]] == [200, 200]
    assert all(b" 503 " in answer and b'"code":"busy"' in answer for answer in refused)
    assert all(re.search(rb"(?i)retry-after: \d", answer) for answer in refused)
    # Those that a thread had begun, and the last one.
    assert overload.installations(server.var) - before <= WRITERS + 1


def test_everybody_who_sends_at_one_moment_and_waits_when_asked_to_arrives(attacked: Attacked) -> None:
    server, chance = attacked.server, random.Random(5)
    callers = [Caller(server, f"10.7.{number}.1") for number in range(HONEST)]
    enrolment = ENROLMENT | {"app": "honest"}

    with ThreadPoolExecutor(HONEST) as clients:
        statuses = clients.map(lambda caller: overload.until_taken(
            lambda: caller.ask("POST", "/api/v1/enrol", enrolment), chance), callers)  # fmt: skip

    assert set(statuses) == {201}
    assert overload.installations(server.var, "honest") == HONEST


def test_refused_bodies_of_one_leave_others_behind_the_address_alone(attacked: Attacked) -> None:
    shared, chance = Caller(attacked.server, "192.0.2.9"), random.Random(6)
    for _ in range(daily_limits.ADDRESS_FACTOR):
        member = shared.enrol()
        assert member is not None
        while member.send(b"[" * 95_000) != 429:
            pass

    neighbour = shared.enrol()

    assert neighbour is not None
    assert neighbour.send(submission(device(*MODELS[0]), session(SPEEDUP, chance))) == 202


def test_the_data_folder_is_closed_to_other_users(attacked: Attacked) -> None:
    var = attacked.server.var

    assert "were open to other users of this machine" in attacked.server.said()
    assert [path for path in (var, *var.rglob("*")) if is_open(path)] == []


def is_open(path: Path) -> bool:
    """Whether other users have rights to `path`. Messages come and go meanwhile."""
    try:
        return bool(path.stat().st_mode & 0o077)
    except FileNotFoundError:
        return False


def test_what_is_no_message_is_put_aside_and_the_worker_goes_on(attacked: Attacked) -> None:
    server, chance = attacked.server, random.Random(7)
    before = server.pids()
    (queue,) = server.var.glob("broker/queue")
    (queue / "0_forged.crowd.msg").write_text('{"body": "b25l", "properties": {}}')

    member = Caller(server, "10.6.0.1").enrol()
    assert member is not None
    assert member.send(submission(device(*MODELS[0]), session(SPEEDUP, chance))) == 202

    until(lambda: server.waiting() == 0 and not (queue / "0_forged.crowd.msg").exists())
    assert [path.name for path in (queue / "dead-letters").iterdir()] == ["0_forged.crowd.msg"]
    assert server.pids() == before


def test_a_reference_device_cannot_send_what_no_device_measures(attacked: Attacked) -> None:
    server = attacked.server
    board = Board(Caller(server, "10.5.0.1"), exploring.start_measured(server.var, SERVICES))
    default = board.take()
    honest = board.result(default, runtime=0.1)

    forged = [
        {"runtime": 1e-9},
        {"runtime": 1e308},
        {"ate_max": 1e308},
        {"software": "9.9.9-not-a-version"},
    ]
    assert [board.send(default, board.result(default, **each)) for each in forged] == [400] * len(forged)
    never_leased = default | {"id": f"{int(default['id'].split('-')[0]) + 1}-0"}
    assert board.send(never_leased, honest) == 410
    assert board.send(default, honest) == board.send(default, honest) == 200
    assert board.send(default, board.result(default, runtime=0.2)) == 409
    other = board.take()
    assert board.send(other, board.result(other, runtime=1e-4)) == 400

    search, *_ = Caller(server, READER).get("/api/v1/explorations")["results"]  # one ships
    page = Caller(server, READER).get(f"/api/v1/explorations/{search['id']}")
    assert [row["objectives"] for row in page["measurements"] if row["objectives"]] == [honest["objectives"]]


def test_an_account_in_another_spelling_is_refused(attacked: Attacked) -> None:
    answer = administrator(attacked.server).post(
        "/admin/auth/user/add/",
        username="Admin",
        password1=WORD * 3,
        password2=WORD * 3,
        usable_password="true",
    )

    assert "case makes no difference" in answer


def pages(server: Serving, sessions: Sequence[Document]) -> dict[str, str]:
    """The pages of all devices and of `sessions`, and a few of each other kind that links lead to."""
    devices = Caller(server, READER).get("/api/v1/devices?limit=1000")["results"]
    slugs = [row["slug"] for row in devices]
    every = [f"/devices/{slug}/" for slug in slugs]
    for one in sessions:
        every += [f"/sessions/{one['id']}/", *(f"/runs/{run['id']}/" for run in one["runs"][:2])]
    waiting = ["/", *every, f"/compare/?devices={','.join(slugs[:6])}", "/api/v1/devices?limit=1000"]
    waiting += [
        "/api/v1/speedups?limit=1000&configuration=all",
        *(f"/api/v1/devices/{slug}" for slug in slugs),
    ]
    texts: dict[str, str] = {}
    seen: Counter[str] = Counter()
    for number, address in enumerate(waiting):
        if address in texts or (seen[kind(address)] >= MOST_OF_A_KIND and address not in every):
            continue
        seen[kind(address)] += 1
        # From several addresses, each within the limit.
        status, content = Caller(server, f"198.51.100.{number // 100}").ask("GET", address)
        assert status in {200, 400}, (address, content)
        text = texts[address] = content.decode(errors="replace")
        waiting += [
            link
            for link in map(unescape, LINK.findall(text))
            if not link.startswith(("/static/", "/admin/", "/data/2", "/data/latest", "/sequences/"))
            and not link.partition("?")[0].endswith(".png")
        ]
    return texts


def kind(address: str) -> str:
    """`address` without what differs between pages of one kind."""
    return re.sub(
        r"(?<=/)(?!figures|tables|embed|api)[a-z0-9]*[-0-9][a-z0-9-]*(?=/|$|\.)",
        "-",
        address.partition("?")[0],
    )


def open_data(server: Serving) -> dict[str, str]:
    """The newest export, file by file, as text; tables by their names."""
    reader = Caller(server, READER)
    texts = {}
    (newest, *_) = reader.get("/api/v1/exports")["results"]
    for file in newest["files"]:
        status, content = reader.ask("GET", file["latest_url"])
        assert status == 200, (file, content)
        if file["format"] == "parquet":
            table = pyarrow.parquet.read_table(io.BytesIO(content)).to_pylist()
            texts[file["table"]] = texts.get(file["table"], "") + str(table)
        else:
            packed = file["name"].endswith(".gz")
            texts[file["name"]] = (gzip.decompress(content) if packed else content).decode()
    return texts
