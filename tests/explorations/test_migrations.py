"""A database that explorations have filled keeps all of it, and the search goes on from its rows."""

from typing import Any

import pytest
from django.db import connection
from django.db.migrations.executor import MigrationExecutor

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.searching import batches, search
from pareto import Explorer, Space
from tests.explorations.conftest import SPACE

BEFORE = [("explorations", "0001_initial")]
DEFAULT = {"compute_size_ratio": 2, "integration_rate": 2, "tracking_rate": 1, "volume_resolution": 64}


def migrate(targets: list[tuple[str, str]]) -> Any:
    executor = MigrationExecutor(connection)
    executor.migrate(targets)
    return MigrationExecutor(connection).loader.project_state(targets).apps


@pytest.fixture
def filled(transactional_db: None) -> dict[str, Any]:
    """As the former version left it: a search with a saved state that has asked twice, and a stopped one."""
    newest = MigrationExecutor(connection).loader.graph.leaf_nodes("explorations")
    apps = migrate(BEFORE)
    Device, Former, Row = (
        apps.get_model("explorations", name) for name in ("ReferenceDevice", "Exploration", "Evaluation")
    )
    explorer = Explorer(Space.from_dict(SPACE), ["ate_max", "runtime"], {"ate_max": 0.05}, method="random")
    wishes = {
        "space": SPACE,
        "sequence": "tiny",
        "sequence_sha256": "0" * 64,
        "reference_device": Device.objects.create(name="bench", queue="bench"),
        "objectives": ["ate_max", "runtime"],
        "limits": {"ate_max": 0.05},
        "method": "random",
        "budget": 9,
        "batch": 3,
    }
    running = Former.objects.create(**wishes)
    Former.objects.create(**wishes, state="stopped")
    given = [(DEFAULT | {"tracking_rate": 3}, "given"), (DEFAULT, "given")]
    asked = [(configuration, "random") for _ in range(2) for configuration in explorer.ask(3)]
    for number, (configuration, phase) in enumerate(given + asked):
        Row.objects.create(
            exploration=running,
            number=number,
            phase=phase,
            configuration=configuration,
            configuration_key=batches.configuration_digest(configuration),
            state="done",
            objectives={"runtime": 0.1 + number, "ate_max": 0.01},
        )
    running.search = explorer.state()
    running.save()
    following = explorer.ask(3)
    migrate(newest)
    return {"running": running.pk, "following": following, "asked": [each for each, _ in asked]}


def test_measurements_stay_and_the_search_asks_for_what_it_would_have_asked(filled: dict[str, Any]) -> None:
    exploration = Exploration.objects.get(pk=filled["running"])
    rows = list(exploration.evaluations.all())

    assert [row.configuration for row in rows[2:]] == filled["asked"]
    assert [row.iteration for row in rows] == [0, 0, 1, 1, 1, 2, 2, 2]
    assert rows[0].index is None  # beside the grid
    space = Space.from_dict(SPACE)
    assert [space.decode(row.index) for row in rows[1:] if row.index is not None] == [
        row.configuration for row in rows[1:]
    ]
    assert [row.objectives["runtime"] for row in rows if row.objectives] == [0.1 + n for n in range(8)]
    explorer = search.informed_explorer(exploration, search.read_rows(exploration))
    assert explorer.ask(3) == filled["following"]


def test_a_stopped_exploration_is_cancelled(filled: dict[str, Any]) -> None:
    assert set(Exploration.objects.values_list("state", flat=True)) == {"running", "cancelled"}
    assert Evaluation.objects.count() == 8


def test_a_search_keeps_its_rows_under_the_methods_new_name(transactional_db: None) -> None:
    newest = MigrationExecutor(connection).loader.graph.leaf_nodes("explorations")
    apps = migrate([("explorations", "0007_runtime_ratio")])
    device = apps.get_model("explorations", "ReferenceDevice").objects.create(name="bench", queue="bench")
    former = apps.get_model("explorations", "Exploration").objects.create(
        space=SPACE,
        sequence="tiny",
        sequence_sha256="0" * 64,
        reference_device=device,
        objectives=["ate_max", "runtime"],
        limits={"ate_max": 0.05},
        method="two-stage",
        options={"initial": 8, "trees": 8, "explore": 20},
        budget=9,
        batch=3,
    )
    migrate(newest)
    migrated = Exploration.objects.get(pk=former.pk)
    assert (migrated.method, migrated.options) == ("bayesian", {"initial": 8})
    assert search.new_explorer(migrated).method == "bayesian"


def test_a_search_of_one_sequence_stays_one(transactional_db: None) -> None:
    newest = MigrationExecutor(connection).loader.graph.leaf_nodes("explorations")
    apps = migrate([("explorations", "0008_bayesian")])
    device = apps.get_model("explorations", "ReferenceDevice").objects.create(name="bench", queue="bench")
    former = apps.get_model("explorations", "Exploration").objects.create(
        space=SPACE,
        sequence="tiny",
        sequence_sha256="0" * 64,
        reference_device=device,
        objectives=["ate_max", "runtime"],
        limits={"ate_max": 0.05},
        budget=9,
        batch=3,
    )
    apps.get_model("explorations", "Evaluation").objects.create(
        exploration=former,
        number=0,
        phase="repeat",
        configuration=DEFAULT,
        configuration_key=batches.configuration_digest(DEFAULT),
        state="done",
        objectives={"runtime": 0.1, "ate_max": 0.01},
    )
    migrate(newest)

    migrated = Exploration.objects.get(pk=former.pk)
    row = migrated.evaluations.get()
    assert migrated.learned_on == [{"name": "tiny", "sha256": "0" * 64}]
    assert (migrated.held_out_sequences, migrated.error_quantile, migrated.failures_allowed) == ([], 1.0, 0)
    assert (row.perturbation, row.parts, row.censored) == (0, None, False)
