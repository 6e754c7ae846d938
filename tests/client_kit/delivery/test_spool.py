"""The spool: what is put in stays until the server has answered, whatever happens to this process."""

import gzip
import itertools
import json
import subprocess
import sys
import uuid
from pathlib import Path
from typing import Any

import pytest

from client_kit.delivery import spool as spool_module
from client_kit.delivery.spool import Item, Spool
from client_kit.errors import HomeError
from client_kit.home import Home

SERVER = "https://frontrunner.example"


def payload(**members: Any) -> dict[str, Any]:
    return {"schema_version": 1, "sessions": [{"id": str(uuid.uuid4()), **members}]}


@pytest.fixture
def small(home: Home, monkeypatch: pytest.MonkeyPatch) -> Spool:
    """A spool of at most two sessions, whose clock goes back once."""
    monkeypatch.setattr(spool_module, "MOST_ITEMS", 2)
    times = itertools.chain([3000.0], itertools.count(1000.0, 1000.0))
    return Spool(home.spool, clock=lambda: next(times))


def states(items: list[Item]) -> list[str]:
    return [item.state for item in items]


def test_a_session_is_kept_as_the_bytes_that_will_travel(spool: Spool) -> None:
    sent = payload(runs=[{"frame_us": [1, 2, 3]}])

    item = spool.put(SERVER, sent)

    body = spool.body(item)
    assert body is not None
    assert json.loads(gzip.decompress(body)) == sent
    assert (item.state, item.server, item.attempts) == ("queued", SERVER, 0)
    assert spool.payload(item) == sent


def test_a_second_process_finds_what_the_first_was_killed_over(home: Home) -> None:
    script = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from client_kit.delivery.spool import Spool\n"
        "spool = Spool(Path(sys.argv[1]))\n"
        "item = spool.put('https://frontrunner.example', {'sessions': [{'id': 'a session'}]})\n"
        "spool.mark_sending(item)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    killed = subprocess.run([sys.executable, "-c", script, str(home.spool)], check=False)
    assert killed.returncode == -9

    spool = Spool(home.spool)
    before = spool.items()
    spool.recover()

    assert [item.state for item in before] == ["sending"]
    after = spool.item("a session")
    assert (after.state, after.attempts) == ("queued", 1)
    assert after.idempotency_key == before[0].idempotency_key
    assert spool.body(after) == spool.body(before[0])


def test_pauses_double_with_full_jitter_up_to_six_hours(home: Home) -> None:
    spool = Spool(home.spool, clock=lambda: 1000.0, jitter=lambda: 0.5)
    item = spool.put(SERVER, payload())
    pauses = []

    for _ in range(14):
        spool.mark_sending(item)
        spool.postpone(item, "no route")
        pauses.append(spool.item(item.id).not_before - 1000.0)

    assert pauses[:4] == [15.0, 30.0, 60.0, 120.0]
    assert pauses[-1] == 0.5 * 6 * 3600


def test_an_eager_sender_skips_its_own_pause_and_never_the_servers(home: Home) -> None:
    spool = Spool(home.spool, clock=lambda: 1000.0, jitter=lambda: 1.0)
    own, asked = spool.put(SERVER, payload()), spool.put(SERVER, payload())
    spool.postpone(own, "no route")
    spool.postpone(asked, "too many requests", retry_after=50.0)
    own, asked = spool.item(own.id), spool.item(asked.id)

    assert own.due(1010.0, eager=True)
    assert not own.due(1010.0)
    assert not asked.due(1010.0, eager=True)
    assert asked.due(1050.0, eager=True)


def test_a_clock_that_was_set_back_delays_nothing(home: Home) -> None:
    spool = Spool(home.spool, clock=lambda: 2_000_000_000.0, jitter=lambda: 1.0)
    item = spool.put(SERVER, payload())
    spool.postpone(item, "no route")

    assert spool.item(item.id).due(1_700_000_000.0)


def test_the_quota_drops_answered_bodies_before_it_expires_unsent_sessions(small: Spool) -> None:
    first, answered = small.put(SERVER, payload()), small.put(SERVER, payload())
    small.settle(answered, "accepted", None, "submission")

    third = small.put(SERVER, payload())
    assert states(small.items()) == ["queued", "accepted", "queued"]
    assert small.body(answered) is None

    small.put(SERVER, payload())
    expired = small.item(first.id)
    assert (expired.state, small.item(third.id).state) == ("expired", "queued")
    assert "at most 2 sessions" in (expired.reason or "")


def test_the_quota_goes_by_what_came_first_whatever_the_clock_says(small: Spool) -> None:
    items = [small.put(SERVER, payload()) for _ in range(3)]

    assert [item.id for item in small.items()] == [item.id for item in items]
    assert states(small.items()) == ["expired", "queued", "queued"]


def test_the_quota_counts_drafts_and_never_drops_them(small: Spool) -> None:
    for _ in range(2):
        small.put(SERVER, payload())

    small.keep_draft(SERVER, payload())
    assert states(small.items()) == ["expired", "queued"]
    small.put(SERVER, payload())

    assert states(small.items()) == ["expired", "expired", "queued"]
    assert len(small.drafts()) == 1


def test_the_quota_counts_bytes_too(home: Home, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spool_module, "LARGEST_BYTES", 150)
    spool = Spool(home.spool)
    items = [spool.put(SERVER, payload()) for _ in range(3)]

    kept = [item for item in items if spool.body(item) is not None]

    assert kept[-1] == items[-1]
    assert sum(item.bytes for item in kept) <= 150


def test_a_payload_with_a_value_that_json_does_not_have_is_refused(spool: Spool) -> None:
    with pytest.raises(ValueError, match="JSON"):
        spool.put(SERVER, payload(ate=float("nan")))

    assert spool.items() == []


def test_a_damaged_file_is_named_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "spool.sqlite3"
    path.write_bytes(b"no database at all" * 100)

    with pytest.raises(HomeError, match=r"spool\.sqlite3 cannot be used: file is not a database"):
        Spool(path)


def test_a_draft_becomes_its_session_under_the_same_key(spool: Spool) -> None:
    sent = payload(runs=[1, 2])
    session_id = sent["sessions"][0]["id"]
    for runs in ([1], [1, 2]):
        spool.keep_draft(SERVER, {**sent, "sessions": [{"id": session_id, "runs": runs}]})
    [draft] = spool.drafts()
    assert (draft.id, draft.state, spool.payload(draft)) == (session_id, "draft", sent)
    assert spool.items() == []

    item = spool.put(SERVER, sent)

    assert (item.state, item.idempotency_key) == ("queued", draft.idempotency_key)
    assert (spool.drafts(), len(spool.items())) == ([], 1)


def test_drafts_are_queued_as_they_are(spool: Spool) -> None:
    contents = [payload(runs=[1]), payload(runs=[2])]
    for content in contents:
        spool.keep_draft(SERVER, content)
    keys = [draft.idempotency_key for draft in spool.drafts()]

    spool.queue_drafts()

    assert (spool.drafts(), states(spool.items())) == ([], ["queued", "queued"])
    assert [item.idempotency_key for item in spool.items()] == keys
    assert [spool.payload(item) for item in spool.items()] == contents


def test_a_draft_is_kept_only_while_that_is_allowed(spool: Spool) -> None:
    def withdrawn() -> None:
        raise HomeError("withdrawn")

    with pytest.raises(HomeError, match="withdrawn"):
        spool.keep_draft(SERVER, payload(), withdrawn)

    assert spool.drafts() == []


def test_clearing_takes_drafts_too(spool: Spool) -> None:
    spool.put(SERVER, payload())
    spool.keep_draft(SERVER, payload())

    assert spool.clear() == 2
    assert spool.items() + spool.drafts() == []
