"""kill -9 at random moments of an exploration: nothing is lost, nothing counts twice, and it ends.

The measurements are looked up in a table; everything else is as an owner of reference devices runs it.
"""

import random
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from django.test import override_settings

from crowd.explorations import services
from crowd.explorations.measuring import leases
from tests.services import explorations, exploring, intake, notes
from tests.services.installation import Installation
from tests.services.table import NOTHING, look_up, measure
from tests.waiting import until

PATIENCE_SECONDS = 600.0
INTERRUPTED = 2  # measurements at least: so many kills wait for the middle of one
# A worker on a busy machine keeps its lease: three losses are a failure, and what is learnt of one differs.
PATIENT = {"TABLE_SECONDS": "0.02", "FRONTRUNNER_LEASE_SECONDS": "12"}
LEARNT = 10  # evaluations, the last ones: the others are random samples
# Many evaluations and several workers once; the others kill the same parts, and look for outliers too.
COMBINATIONS: dict[str, dict[str, Any]] = {
    "embedded": {"budget": 240, "machines": 3, "recheck": False},
    "redis postgresql": {"budget": 60, "machines": 2},
    "rabbitmq postgresql": {"budget": 60, "machines": 2},
}


@pytest.fixture(params=COMBINATIONS)
def combination(request: pytest.FixtureRequest) -> str:
    """Broker and database."""
    return str(request.param)


@pytest.fixture
def wishes(combination: str) -> dict[str, Any]:
    """What is explored there: ten batches, of which the last one is learnt at its end."""
    wanted = COMBINATIONS[combination]
    budget = wanted["budget"]
    return wanted | {"batch": budget // 10, "options": {"initial": budget - LEARNT}, "repeats": 1}


@pytest.fixture
def installation(
    request: pytest.FixtureRequest, combination: str, wishes: dict[str, Any], tmp_path: Path
) -> Iterator[Installation]:
    programs = [] if combination == "embedded" else combination.split()
    broker, database = [request.getfixturevalue(name) for name in programs] or (None, None)
    var, workers, more = tmp_path / "var", wishes["machines"], dict(PATIENT)
    with ExitStack() as stack:
        if database is None:
            intake.prepare(var, {})
        else:
            more["DATABASE_URL"] = stack.enter_context(intake.prepared_on(database, var))
        yield stack.enter_context(Installation(var, broker, database, workers, **more))


def undisturbed(var: Path, wishes: dict[str, Any]) -> list[tuple[int, str, dict[str, int]]]:
    """Number, phase and configuration of what the exploration evaluates when nothing ever fails."""
    with override_settings(FRONTRUNNER_VAR=var, FRONTRUNNER_SEQUENCES=[var / "sequences"], TABLE_SECONDS=0.0):
        exploration = explorations.create(var, **wishes)
        while waiting := leases.pending_for(exploration.reference_device) or services.advance(exploration.pk):
            for each in list(waiting):
                with leases.leased(each.pk) as evaluation:
                    assert evaluation is not None
                    leases.record(evaluation, measure(evaluation))
    return list(exploration.evaluations.order_by("number").values_list("number", "phase", "configuration"))


def measured(installation: Installation) -> int:
    """How many evaluations were measured."""
    return len({note.key for note in notes.read(installation.var) if note.what == "ended"})


@pytest.mark.django_db  # for what is done undisturbed
def test_an_exploration_survives_every_kill(
    installation: Installation, wishes: dict[str, Any], own_data_folder: Path
) -> None:
    expected = undisturbed(own_data_folder, wishes)
    chance = random.Random(0)
    kills = installation.kills(chance)
    # Some kills wait for a measurement: the last ones are for those that still come then.
    moments = sorted(chance.randrange(wishes["budget"] * 4 // 5) for _ in kills)

    key = exploring.start(installation.var, installation.services, **wishes)
    for moment, kill in zip(moments, kills, strict=True):
        look = chance.uniform(0.01, 0.2)  # between two looks: the kill comes at any moment
        until(lambda moment=moment: measured(installation) >= moment, PATIENCE_SECONDS, look)  # type: ignore[misc]
        kill()
    until(lambda: installation.state() == "done", PATIENCE_SECONDS, pause=1.0)

    rows = exploring.rows(installation.var, installation.services, key)
    assert [(row["number"], row["phase"], row["configuration"]) for row in rows] == expected
    for row in rows:
        assert row["objectives"] == look_up(row["configuration"])
        assert row["error"] == ("" if row["objectives"] else NOTHING)
    begun = Counter((note.key, note.attempt) for note in notes.read(installation.var) if note.what == "begun")
    assert set(begun.values()) == {1}
    assert {(row["id"], row["attempt"]) for row in rows} <= set(begun)
    # Two kills may interrupt one evaluation: its third attempt counts, too.
    assert sum(max(row["attempt"] - 1, 0) for row in rows) >= INTERRUPTED
    assert all(worker.process.poll() is None for worker in installation.workers)
