"""An exploration over two systems: one front on its page, a draft front for each."""

from pathlib import Path
from typing import Any

import pytest
from django.core.exceptions import ValidationError
from django.test import Client
from django.urls import reverse

from crowd.dashboard.drawings.explorations import plane
from crowd.dashboard.figures.palette import LIGHT
from crowd.explorations import services, space_choice
from crowd.explorations.measuring import measurement
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.outcomes import publishing
from crowd.explorations.outcomes.watching import watch
from crowd.explorations.searching.applications import SEVERAL
from pareto import Space
from slam.datasets import open_sequence
from slam.isolated import Measurement
from tests.builders.explorations import record
from tests.slam.tiny import write_tiny_pack

KFUSION, ELASTICFUSION = "system == 'kfusion'", "system == 'elasticfusion'"
SPACE: dict[str, Any] = {
    "name": "systems-small",
    "parameters": [
        {"name": "system", "type": "categorical", "values": ["kfusion", "elasticfusion"]},
        {"name": "tracking_rate", "type": "ordinal", "values": [1, 2, 3], "condition": KFUSION},
        {
            **{"name": "compute_size_ratio", "type": "ordinal", "values": [1, 2, 4], "default": 2},
            "condition": KFUSION,
        },
        {"name": "icp_weight", "type": "ordinal", "values": [10, 20, 50], "condition": ELASTICFUSION},
        {"name": "depth_cutoff", "type": "ordinal", "values": [3.0, 5.0], "condition": ELASTICFUSION},
        {"name": "build_threads", "type": "ordinal", "values": [0, 1]},
    ],
}


def found(configuration: dict[str, Any]) -> Measurement:
    """What some machine might measure: ElasticFusion is slower, and so accurate that it is on the front."""
    if configuration["system"] == "kfusion":
        runtime = 0.1 / configuration.get("compute_size_ratio", 2) / configuration.get("tracking_rate", 1)
    else:
        runtime = 2.0 / configuration["icp_weight"] + 0.01 * configuration["depth_cutoff"]
    error = 0.001 / runtime
    if configuration.get("build_threads") == 1:
        runtime *= 0.9
    values = {"runtime": runtime, "ate_max": error, "ate_mean": error / 2, "ate_rmse": error / 2}
    return Measurement(values, {"tracking": runtime}, {"platform": "p", "name": "Bench", "driver": "1"})


@pytest.fixture
def explored(unsaved: Exploration, tmp_path: Path, settings: Any) -> Exploration:
    """Both systems, searched and repeated to the end."""
    pack = write_tiny_pack(tmp_path, colour=True)
    settings.FRONTRUNNER_SEQUENCES = [tmp_path]
    unsaved.application, unsaved.space = SEVERAL, SPACE
    unsaved.sequence_sha256, unsaved.budget = open_sequence(pack).sha256, 24
    exploration = services.create(unsaved)
    while waiting := services.pending_evaluations(exploration) or services.advance(exploration.pk):
        for pending in waiting:
            record(pending, found(pending.configuration))
    exploration.refresh_from_db()
    return exploration


def test_each_system_s_default_is_measured_to_its_end(explored: Exploration) -> None:
    given = explored.evaluations.filter(phase=Evaluation.Phase.GIVEN)
    assert set(given.values_list("label", flat=True)) == {
        *("default", "fast1", "fast2", "fast3", "fast4", "elasticfusion-default")
    }
    for label, system in (("default", "kfusion"), ("elasticfusion-default", "elasticfusion")):
        row = given.get(label=label)
        assert (row.configuration["system"], row.stop_above) == (system, [])


@pytest.mark.parametrize("application", ["kfusion", "elasticfusion"])
def test_each_system_has_a_draft_of_its_own_without_options_of_a_build(
    explored: Exploration, application: str
) -> None:
    rows, reason = publishing.candidates(explored, application)
    assert reason == ""
    names = {row.key: row.name for row in rows if row.name}
    front = publishing.create_draft(explored, names, "anna", application)
    assert front.slug == f"{application}-1"
    shown = front.content.every
    assert {"default", "best"} <= {row.name for row in shown}
    space_only = {"system", "build_threads"}
    own = {"tracking_rate"} if application == "kfusion" else {"icp_weight"}
    for row in shown:
        assert own <= row.parameters.keys()
        assert not space_only & row.parameters.keys()
    parameters = [str(sorted(row.parameters.items())) for row in shown]
    assert len(parameters) == len(set(parameters))
    both = {row.configuration_key for row in explored.evaluations.all()}
    assert len(both) > len(rows)  # what differs only in the build is one point


def test_a_named_point_is_measured_again_with_its_system(explored: Exploration) -> None:
    rows, _ = publishing.candidates(explored, "elasticfusion")
    again = publishing.measure_again(explored, [rows[0].key], 1)
    assert [row.configuration["system"] for row in again] == ["elasticfusion"]
    assert again[0].label == "elasticfusion-default"


def test_the_page_has_one_front_coloured_by_system(client: Client, explored: Exploration) -> None:
    page = client.get(reverse("dashboard:exploration", args=[explored.pk]))
    assert page.status_code == 200
    seen = watch(explored.pk)
    assert seen is not None
    traces = {trace.name.split(" (")[0]: trace for trace in plane(seen, LIGHT).data if trace.name}
    assert {"KinectFusion", "ElasticFusion"} <= traces.keys()
    colours = {traces[name].marker.color for name in ("KinectFusion", "ElasticFusion")}
    assert set(traces["front"].marker.color) == colours
    assert len(colours) == 2


def test_the_administration_shows_the_points_of_the_system_that_is_chosen(
    administrator: Client, explored: Exploration
) -> None:
    path = reverse("admin:explorations_exploration_points", args=[explored.pk])
    first = administrator.get(path).content.decode()
    second = administrator.get(path, {"application": "elasticfusion"}).content.decode()
    assert "?application=elasticfusion" in first
    assert "tracking rate" in first.lower()
    assert "depth cutoff" not in first.lower()
    assert "depth cutoff" in second.lower()
    assert "tracking rate" not in second.lower()


def test_a_machine_is_asked_to_run_the_system(explored: Exploration, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(measurement.isolated, "measure", lambda *given, **_: asked.append(given[:2]))
    for label in ("default", "elasticfusion-default"):
        measurement.measure(explored.evaluations.filter(label=label)[0])
    assert [system for system, _ in asked] == ["kfusion", "elasticfusion"]
    assert not any("system" in configuration for _, configuration in asked)


def test_a_ratio_to_one_default_is_refused(unsaved: Exploration) -> None:
    unsaved.application, unsaved.space = SEVERAL, SPACE
    unsaved.objectives = ["ate_max", "runtime_ratio"]
    with pytest.raises(ValidationError, match="kfusion and elasticfusion have one each"):
        services.create(unsaved)


def test_the_shipped_space_over_both_can_be_chosen_and_a_wrong_one_names_the_system() -> None:
    assert "systems" in {path.stem for path in space_choice.shipped_spaces()}
    system, space = space_choice.space_of_choice("systems")
    assert system == SEVERAL
    space_choice.check_fits(system, space)
    wrong = {"name": "two", "parameters": [{"name": "system", "type": "categorical", "values": ["slow"]}]}
    assert space_choice.system_for(Space.from_dict(wrong), "") == SEVERAL
    with pytest.raises(ValidationError, match="system is 'slow'"):
        space_choice.check_fits(SEVERAL, wrong)
