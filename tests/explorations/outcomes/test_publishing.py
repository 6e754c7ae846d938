"""From an exploration to a draft front: which points, under which names, measured how often."""

import shlex
from typing import Any

import pytest
from django.core.management import call_command

from crowd.explorations import services
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.outcomes import creation_command, publishing
from crowd.explorations.preparing import preparation
from crowd.explorations.searching import batches, points
from crowd.explorations.searching.points import Point, spread
from crowd.fronts.content.front_file import InvalidFrontError
from crowd.fronts.publishing import services as fronts
from tests.builders.explorations import SPACE, finish, run_to_the_end, shipped_space


def point(runtime: float, error: float, label: str = "", repeats: int = 1) -> Point:
    values = {"runtime": runtime, "ate_max": error, "ate_mean": error / 2}
    return Point(
        {"n": f"{runtime} {error}"}, label, "random", values, repeats + 1, repeats, low=values, high=values
    )


def test_names_tell_default_best_and_accurate_and_keep_known_ones_that_are_valid() -> None:
    default, fast1, fast2 = (
        point(0.1, 0.01, "default"),
        point(0.02, 0.04, "fast1"),
        point(0.03, 0.06, "fast2"),
    )
    middle, accurate, dominated = point(0.04, 0.02), point(0.2, 0.005), point(0.06, 0.03, "fast3")
    lost = point(0.001, 0.5)

    named = publishing.name_points([default, fast1, fast2, middle, accurate, dominated, lost], {})

    assert named == {
        "default": default,
        "best": fast1,
        "accurate": accurate,
        "knee": middle,
        "fast3": dominated,
    }


def test_a_point_that_leaves_out_frames_is_adaptive_and_never_best() -> None:
    points = [point(0.1, 0.01, "default"), point(0.02, 0.02), point(0.01, 0.03), point(0.005, 0.04)]
    for one, limit in zip(points, (0, 0, 3, 3), strict=True):
        one.configuration.clear()
        one.configuration.update(skip_limit=limit, mu=one.values["ate_max"])

    named = publishing.name_points(points, {}, "kfusion")

    assert named["best"] is points[1]
    assert named["adaptive"] is points[3]


def test_once_points_were_measured_again_a_lucky_single_measurement_is_not_published() -> None:
    named = publishing.name_points(
        [point(0.1, 0.01, "default"), point(0.05, 0.01), point(0.01, 0.01, repeats=0)], {}
    )

    assert named["best"].values["runtime"] == 0.05


def test_no_front_without_a_default_or_without_anything_faster() -> None:
    with pytest.raises(publishing.NothingToPublishError, match="default"):
        publishing.name_points([point(0.1, 0.01)], {})
    with pytest.raises(publishing.NothingToPublishError, match="faster"):
        publishing.name_points([point(0.1, 0.01, "default"), point(0.05, 0.06), point(0.2, 0.001)], {})


def test_a_long_front_is_thinned_evenly_and_keeps_its_ends() -> None:
    points = [point(2.0**step, 1.0) for step in range(9)]

    chosen = spread(points, 3)

    assert [row.values["runtime"] for row in chosen] == [1.0, 16.0, 256.0]
    assert spread(points, 20) == points


def test_a_point_over_a_part_of_the_sequence_is_not_named(unsaved: Exploration) -> None:
    unsaved.frames, unsaved.repeats = 11, 0
    exploration = run_to_the_end(services.create(unsaved))

    measured = points.measured_points(exploration.evaluations.all())

    assert not any(point.whole for point in measured)
    with pytest.raises(publishing.NothingToPublishError, match="over the whole sequence"):
        publishing.name_points(measured, {})


def test_the_knee_is_the_best_compromise() -> None:
    default, best, accurate = point(1.0, 0.01, "default"), point(0.1, 0.04), point(0.9, 0.001)
    bend, other = point(0.15, 0.005), point(0.5, 0.004)

    named = publishing.name_points([default, best, accurate, bend, other], {})

    assert named["knee"] == bend
    assert named["front-01"] == other


def choice(exploration: Exploration) -> dict[str, str]:
    """The proposed names by key."""
    candidates, reason = publishing.candidates(exploration)
    assert reason == ""
    return {row.key: row.name for row in candidates if row.name}


def test_a_draft_holds_the_chosen_points_with_their_spread(explored: Exploration) -> None:
    names = {key: name for key, name in choice(explored).items() if name in {"default", "best"}}

    front = publishing.create_draft(explored, names, by="anna")

    assert (front.slug, front.state, front.content.provenance["search"]["method"]) == (
        "kfusion-1",
        "draft",
        "random",
    )
    assert front.content.protocol.frames == 12  # as many as the sequence has
    default, best = front.content.configurations
    assert (default.name, best.name) == ("default", "best")
    assert best.runtime < default.runtime
    assert best.predicted.measurements == explored.repeats
    low, high = best.predicted.runtime_low, best.predicted.runtime_high
    assert low is not None
    assert high is not None
    assert low <= best.runtime <= high
    assert publishing.create_draft(explored, names, by="anna").slug == "kfusion-2"


def test_the_median_of_the_repeats_is_published_and_not_what_chose_the_point(
    explored: Exploration,
) -> None:
    rows = explored.evaluations.filter(label="default")
    assert rows.count() == 3
    for runtime, row in zip([0.001, 3.0, 5.0], rows, strict=True):
        Evaluation.objects.filter(pk=row.pk).update(objectives={**row.objectives, "runtime": runtime})

    predicted = publishing.front_document(explored, "1")["configurations"][0]["predicted"]

    assert (predicted["runtime_low"], predicted["runtime"], predicted["runtime_high"]) == (3.0, 4.0, 5.0)


def test_a_point_that_was_not_measured_again_is_no_figure_yet(exploration: Exploration) -> None:
    exploration.points = 2
    exploration.save()
    run_to_the_end(exploration)
    names = choice(exploration)
    once = next(
        batches.configuration_digest(each.configuration)
        for each in points.measured_points(exploration.evaluations.all())
        if not each.repeats
    )
    names[once] = "another"

    with pytest.raises(publishing.NotReadyError, match="another: repeated fewer than 2 times"):
        publishing.create_draft(exploration, names, by="anna")

    new = publishing.measure_again(exploration, [once], 2)
    assert [(row.phase, row.frames) for row in new] == [("repeat", None)] * 2
    run_to_the_end(exploration)
    drafted = publishing.create_draft(exploration, names, by="anna")
    (another,) = (point for point in drafted.content.configurations if point.name == "another")
    assert another.predicted.measurements == 2


def test_the_named_points_are_measured_again_in_turn(explored: Exploration) -> None:
    names = choice(explored)

    new = publishing.measure_again(explored, names, 3)

    keys = [row.configuration_key for row in new]
    assert keys == list(names) * 3
    explored.refresh_from_db()
    assert explored.state == "running"
    finish(new)


@pytest.mark.parametrize(
    ("change", "error", "complaint"),
    [
        ({"best": "default"}, InvalidFrontError, "names repeat"),
        ({"best": ""}, InvalidFrontError, "best is missing: clients measure it"),
        ({"best": "Best one"}, InvalidFrontError, "lower-case letters"),
        ({"default": "", "best": "default"}, InvalidFrontError, "best is missing: clients measure it"),
    ],
)
def test_a_choice_that_is_no_front_is_refused(
    explored: Exploration, change: dict[str, str], error: type[Exception], complaint: str
) -> None:
    names = {key: change.get(name, name) for key, name in choice(explored).items()}

    with pytest.raises(error, match=complaint):
        publishing.create_draft(explored, {key: name for key, name in names.items() if name}, by="anna")


def test_what_breaks_the_limit_cannot_be_best(explored: Exploration) -> None:
    names = choice(explored)
    best = next(key for key, name in names.items() if name == "best")
    for row in explored.evaluations.filter(configuration_key=best):
        parts = [{**part, "ate_max": 0.06} for part in row.parts or []]
        Evaluation.objects.filter(pk=row.pk).update(parts=parts or None)

    with pytest.raises(publishing.NotReadyError, match=r"best: its error on tiny is 6\.0 cm, not below 5 cm"):
        publishing.create_draft(explored, names, by="anna")


def test_evaluations_that_an_earlier_exploration_made_are_not_counted_as_this_ones(
    explored: Exploration,
) -> None:
    warm = services.create(services.clone(explored, warm_start_from=explored, budget=3))
    run_to_the_end(warm)

    provenance = publishing.front_document(warm, "1")["provenance"]

    measured_here = warm.evaluations.exclude(phase__in=services.COPIED).count()
    assert provenance["evaluations"] == measured_here < warm.evaluations.count()
    assert provenance["warm_start"] == f"exploration {explored.pk}"


def test_the_provenance_names_every_device_that_measured(explored: Exploration) -> None:
    first = explored.evaluations.order_by("number").first()
    assert first is not None
    assert first.device is not None
    first.device |= {"name": "Another CPU"}
    first.save()
    explored.command = "python manage.py explore --space /home/anna/space.json"

    provenance = publishing.front_document(explored, "1")["provenance"]

    assert (provenance["device"], provenance["driver"]) == ("Another CPU, Bench CPU", "1.0")
    assert provenance["command"] == "python manage.py explore --space space.json"


def test_where_all_was_known_before_there_is_no_front_and_no_crash(explored: Exploration) -> None:
    warm = services.create(services.clone(explored, warm_start_from=explored))

    with pytest.raises(publishing.NothingToPublishError, match="repeated 2 times"):
        publishing.front_document(warm, "1")


def test_over_one_sequence_the_error_of_what_somebody_calls_best_stays_below_the_limit(
    explored: Exploration,
) -> None:
    names = choice(explored)
    for row in explored.evaluations.exclude(label="default"):
        Evaluation.objects.filter(pk=row.pk).update(objectives={**row.objectives, "ate_max": 0.06})

    with pytest.raises(publishing.NotReadyError, match=r"best: its error of 6\.0 cm is not below 5 cm"):
        publishing.create_draft(explored, names, by="anna")


def test_a_published_draft_of_an_exploration_is_what_clients_measure(
    explored: Exploration, client: Any
) -> None:
    front = publishing.create_draft(explored, choice(explored), by="anna")
    assert client.get("/api/v1/manifest").status_code == 404

    run_to_the_end(preparation.create(front))
    fronts.publish(fronts.submit(front))

    manifest = client.get("/api/v1/manifest").json()
    assert manifest["front_version"] == "kfusion-1"
    assert [row["name"] for row in manifest["configurations"]][:2] == ["default", "best"]


@pytest.mark.parametrize(
    "wish",
    [
        {},
        {"limits": {"ate_max": 0.04, "runtime": 0.1}, "frames": 11, "options": {"initial": 3}},
        {"limits": {}},
        {"synchronous": False, "recheck": False, "seed": 7, "points": 2, "repeats": 0, "batch": 1},
    ],
)
def test_the_command_of_an_exploration_starts_the_same_one(
    unsaved: Exploration, wish: dict[str, Any], unread_queues: None
) -> None:
    for name, value in ({"space": shipped_space(), "method": "bayesian"} | wish).items():
        setattr(unsaved, name, value)
    created = services.create(unsaved)

    call_command(*shlex.split(creation_command.creation_command(created))[2:])

    again = Exploration.objects.latest("pk")
    assert again.pk != created.pk
    ignored = {"id", "command", "created_at", "finished_at"}
    for field in Exploration._meta.concrete_fields:
        if field.name not in ignored:
            assert getattr(again, field.name) == getattr(created, field.name), field.name


@pytest.mark.parametrize("wish", [{"options": {"points": 8}, "method": "bayesian"}, {"space": SPACE}])
def test_what_no_command_can_say_is_not_made_up(unsaved: Exploration, wish: dict[str, Any]) -> None:
    for name, value in ({"space": shipped_space()} | wish).items():
        setattr(unsaved, name, value)

    assert creation_command.creation_command(services.create(unsaved)) == ""
