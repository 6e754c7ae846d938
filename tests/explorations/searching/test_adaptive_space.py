"""A space with parameters that may change nothing: machines, digests and fronts do without them."""

import json
from pathlib import Path
from typing import Any

import pytest
from django.core.exceptions import ValidationError

import pareto
from crowd.explorations import services
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from crowd.explorations.searching import points
from crowd.explorations.searching.batches import configuration_digest
from slam.definitions import OPTIONAL, SYSTEMS
from tests.builders.explorations import measured_on, record, run_to_the_end

SPACES = Path(pareto.__file__).parent / "spaces"
PHASES = ("random", "active")


def space(name: str) -> dict[str, Any]:
    described: dict[str, Any] = json.loads((SPACES / f"{name}.json").read_text())
    return described


@pytest.fixture
def adaptive(unsaved: Exploration) -> Exploration:
    unsaved.space, unsaved.budget, unsaved.batch = space("kfusion-adaptive"), 16, 8
    return services.create(unsaved)


def test_inactive_parameters_are_left_out_and_each_configuration_is_in_the_space(
    adaptive: Exploration,
) -> None:
    run_to_the_end(adaptive)

    searched = list(adaptive.evaluations.filter(phase__in=PHASES))
    assert len(searched) == 16
    assert any("skip_limit" in row.configuration for row in searched)
    for row in searched:
        unused = [name for name in OPTIONAL if row.configuration.get(name, 1) in (0, None)]
        assert (unused, row.index is None) == ([], False)
        assert SYSTEMS["kfusion"].complete(row.configuration) == row.configuration


def test_a_configuration_that_does_not_adapt_is_the_same_as_before(adaptive: Exploration) -> None:
    default = adaptive.evaluations.get(label="default")
    unused = {"skip_limit": 0, "skip_translation": None, "integrate_translation": 0.0}

    assert len(default.configuration) == 9
    assert configuration_digest(default.configuration | unused) == default.configuration_key
    assert configuration_digest(default.configuration | {"skip_limit": 1}) != default.configuration_key


def test_points_that_compute_every_frame_are_repeated_beside_faster_ones_that_adapt(
    adaptive: Exploration,
) -> None:
    run_to_the_end(adaptive)
    evaluations = list(adaptive.evaluations.all())
    for row in evaluations:
        if row.phase in PHASES:  # whatever leaves out frames is better in every way
            values = (0.001, 0.01) if row.configuration.get("skip_limit") else (0.002, 0.02)
            row.objectives = dict.fromkeys(adaptive.objectives, values[0]) | {"ate_max": values[1]}

    chosen = points.worth_publishing(adaptive, evaluations)

    both = [points.skips(adaptive.application, point) for point in chosen if not point.label]
    assert True in both
    assert False in both


def test_a_search_of_the_papers_space_is_where_an_adaptive_one_starts(unsaved: Exploration) -> None:
    unsaved.space, unsaved.method = space("kfusion"), "bayesian"
    earlier = run_to_the_end(services.create(unsaved))
    board = ReferenceDevice.objects.create(name="board", queue="board")
    kept = services.create(services.clone(earlier, space=space("kfusion-adaptive"), warm_start_from=earlier))
    guided = services.create(
        services.clone(
            earlier, space=space("kfusion-adaptive"), warm_start_from=earlier, reference_device=board
        )
    )

    for exploration, phase in ((kept, "known"), (guided, "prior")):
        copied = exploration.evaluations.filter(phase=phase, copied_from__phase__in=PHASES)
        assert copied.count() == 6
        assert not copied.filter(index=None).exists()
        assert run_to_the_end(exploration).state == Exploration.State.DONE


def test_the_largest_times_are_minimised_once_they_are_measured(unsaved: Exploration) -> None:
    unsaved.objectives = ["ate_max", "runtime_p95"]
    exploration = services.create(unsaved)

    def measured(evaluation: Evaluation) -> Any:
        result = measured_on(evaluation)
        times = {"runtime_p95": 2 * result.objectives["runtime"], "runtime_max": 1.0}
        return result.__class__(result.objectives | times, result.stages, result.device, result.parts)

    for waiting in services.pending_evaluations(exploration):
        record(waiting, measured(waiting))
    assert services.advance(exploration.pk)

    exploration.evaluations.update(objectives={"runtime": 0.1, "ate_max": 0.01, "runtime_p95": 0.2})
    wanted = services.clone(exploration, objectives=["ate_max", "runtime_max"], warm_start_from=exploration)
    with pytest.raises(ValidationError, match="did not measure runtime_max"):
        services.create(wanted)
