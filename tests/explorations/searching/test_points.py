"""A front is of one kind: over the frames that the search runs, or over the whole sequence."""

from dataclasses import replace
from typing import Any

import pytest
from django.test import Client

from crowd.explorations import services, steering
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.outcomes import publishing
from crowd.explorations.outcomes.report import markdown
from crowd.explorations.searching import batches, points, search
from tests.builders.explorations import measurement, record, run_to_the_end

FRAMES = 11


def measure(evaluations: list[Evaluation]) -> None:
    """Over the whole sequence everything takes twice as long and errs four times as far."""
    for waiting in evaluations:
        result = measurement(waiting.configuration)
        if waiting.frames is None:
            factors = {"runtime": 2.0, "ate_max": 4.0}
            values = {name: value * factors.get(name, 1) for name, value in result.objectives.items()}
            result = replace(result, objectives=values)
        record(waiting, result)


@pytest.fixture
def short(unsaved: Exploration) -> Exploration:
    """An exploration whose search runs fewer frames, everything searched and nothing measured again yet."""
    unsaved.frames, unsaved.budget, unsaved.batch = FRAMES, 30, 30
    exploration = services.create(unsaved)
    measure(services.pending_evaluations(exploration))
    measure(services.advance(exploration.pk))
    return exploration


def rows(exploration: Exploration) -> list[Evaluation]:
    return list(exploration.evaluations.order_by("number"))


def finish(exploration: Exploration) -> None:
    while waiting := services.pending_evaluations(exploration) or services.advance(exploration.pk):
        measure(waiting)
    exploration.refresh_from_db()


def keys(listed: list[points.Point]) -> set[str]:
    return {batches.configuration_digest(point.configuration) for point in listed}


def test_what_is_measured_again_is_chosen_by_the_searchs_front_alone(short: Exploration) -> None:
    wanted = keys(points.worth_publishing(short, rows(short)))

    finish(short)

    again = [row for row in rows(short) if row.phase == "repeat"]
    assert {row.configuration_key for row in again} == wanted
    assert len(again) == short.repeats * len(wanted)
    assert len({row.iteration for row in again}) == 1
    assert keys(points.worth_publishing(short, rows(short))) == wanted


def test_the_front_is_the_searchs_until_something_ran_over_the_whole_sequence(short: Exploration) -> None:
    before = points.best_points(short, points.measured_points(rows(short)))
    assert len(before) > short.points
    assert not any(point.whole for point in before)

    finish(short)

    after = points.best_points(short, points.measured_points(rows(short)))
    assert after
    assert all(point.whole for point in after)
    whole = [point for point in points.measured_points(rows(short)) if point.whole]
    assert len(whole) < len(points.measured_points(rows(short)))
    assert not any(
        other.values["runtime"] < point.values["runtime"]
        and other.values["ate_max"] < point.values["ate_max"]
        for point in after
        for other in whole
    )


def test_the_searchs_points_stay_to_be_chosen(short: Exploration) -> None:
    searched = keys(points.best_points(short, points.measured_points(rows(short))))

    finish(short)

    candidates, _ = publishing.candidates(short)
    assert searched <= {row.key for row in candidates}
    assert any(not row.point.whole for row in candidates)


def test_whoever_shows_a_front_says_of_which_kind_it_is(short: Exploration, client: Client) -> None:
    def published() -> Any:
        return client.get(f"/api/v1/explorations/{short.pk}").json()

    assert {point["frames"] for point in published()["front"]} == {FRAMES}
    assert markdown(short).count("Measured over the first 11 frames:") == 2

    finish(short)

    assert published()["frames"] == FRAMES
    assert {point["frames"] for point in published()["front"]} == {None}
    assert markdown(short).count("Measured over the first 11 frames:") == 1
    assert "Measured over the whole sequence:" in markdown(short)


def test_a_lucky_single_measurement_is_on_no_finished_front(explored: Exploration, client: Client) -> None:
    again = {row.configuration_key for row in rows(explored) if row.phase == "repeat"}
    lucky = next(row for row in rows(explored) if row.configuration_key not in again)
    lucky.objectives = {"runtime": 1e-6, "ate_max": 1e-6}
    lucky.save()

    def published_front() -> list[dict[str, Any]]:
        return list(client.get(f"/api/v1/explorations/{explored.pk}").json()["front"])

    front = published_front()
    assert len(front) > 1
    assert all(point["measurements"] > 1 for point in front)

    services.raise_budget(explored, explored.budget + 1)

    assert [point["configuration"] for point in published_front()] == [lucky.configuration]


def test_where_the_search_runs_over_everything_nothing_is_set_apart(explored: Exploration) -> None:
    every = points.measured_points(rows(explored))

    assert points.searched_points(explored, rows(explored)) == points.comparable(every) == every
    assert "Measured over" not in markdown(explored)


def test_what_another_exploration_measured_is_none_of_this_ones(exploration: Exploration) -> None:
    record(services.pending_evaluations(exploration)[0], "no memory")
    run_to_the_end(exploration)
    assert "retry" in {step.name for step in steering.available_steps(exploration)}

    warm = services.create(services.clone(exploration, warm_start_from=exploration))

    assert warm.evaluations.filter(phase="known", state="failed").count() == 1
    assert "retry" not in {step.name for step in steering.available_steps(warm)}
    measure(services.pending_evaluations(warm))
    phases = {point.label: point.phase for point in points.measured_points(rows(warm)) if point.label}
    assert set(phases.values()) == {"given"}
    assert "known" in {point.phase for point in points.measured_points(rows(warm))}


def test_where_measurements_differ_the_recommended_are_worth_publishing(short: Exploration) -> None:
    evaluations = rows(short)
    searched = points.searched_points(short, evaluations)
    chosen = [point.configuration for point in searched if not point.label][:2]

    worth = points.worth_publishing(short, evaluations, chosen)

    given = [point for point in searched if point.label]
    assert keys(worth) == keys(given) | {
        batches.configuration_digest(configuration) for configuration in chosen
    }


def test_a_search_recommends_once_its_measurements_differ(short: Exploration) -> None:
    finish(short)
    assert search.recommended_configurations(short, search.read_rows(short)) is None
    row = short.evaluations.filter(phase="random", state="done").order_by("number").first()
    assert row is not None
    doubled = {name: 2 * value for name, value in row.objectives.items()}
    batches.add_evaluations(short, [(row.configuration, Evaluation.Phase.AGAIN, "")])
    again = short.evaluations.latest("number")
    measured = {"state": "done", "objectives": doubled, "finished_at": row.finished_at}
    Evaluation.objects.filter(pk=again.pk).update(**measured)
    assert search.recommended_configurations(short, search.read_rows(short))
