"""Workers, reapers, requests for more and administrators at once on a real PostgreSQL."""

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.services import exploring, intake, racing
from tests.services.postgresql import PostgreSQL
from tests.services.serving import Services
from tests.services.table import look_up


@pytest.fixture
def environment(postgresql: PostgreSQL, tmp_path: Path) -> Iterator[Services]:
    """That of a server on PostgreSQL."""
    with intake.prepared_on(postgresql, tmp_path / "var") as url:
        yield exploring.SETTINGS | {"DATABASE_URL": url}


def test_many_hands_lose_nothing_and_count_nothing_twice(tmp_path: Path, environment: Services) -> None:
    var = tmp_path / "var"
    race = exploring.race(var, environment)

    assert race["errors"] == []  # neither a deadlock nor more measurements than machines
    begun, stored = ([tuple(lease) for lease in race[name]] for name in ("begun", "stored"))
    assert max(Counter(begun).values()) == 1
    assert max(Counter(stored).values()) == 1
    assert race["other"][1] == "cancelled"

    rows = exploring.rows(var, environment, race["key"])
    assert [row["number"] for row in rows] == list(range(len(rows)))
    found = [json.dumps(row["configuration"]) for row in rows if row["phase"] == "random"]
    assert len(found) == len(set(found)) == racing.BUDGETS[-1]
    for row in rows:
        values = look_up(row["configuration"])
        lost = row["error"].startswith("lost ")
        assert row["state"] == ("failed" if lost or values is None else "done")
        assert row["objectives"] == (None if lost else values)
        assert ((row["id"], row["attempt"]) in stored) == (not lost)
    # Of the cancelled one what was measured stays, and nothing else is left running.
    for row in exploring.rows(var, environment, race["other"][0]):
        assert row["state"] != "running"
