"""The ratio to the default's runtime: a host that slows down changes no speedup."""

from dataclasses import replace
from typing import Any

import pytest
from django.core.exceptions import ValidationError

from crowd.explorations import services
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.outcomes import publishing
from crowd.explorations.outcomes.watching import results_of, watch
from crowd.explorations.searching import points, search
from tests.builders.explorations import finish, measured_on, measurement, record

MIDDLE = 9  # evaluations before the host slows down: all known ones and a part of the search


@pytest.fixture
def comparing(unsaved: Exploration) -> Exploration:
    """A created exploration that minimises the ratio."""
    unsaved.objectives = ["ate_max", "runtime_ratio"]
    return services.create(unsaved)


def measure(rows: list[Evaluation], slowdown: float = 1.0) -> None:
    """Record deterministic values (simulated), with runtimes `slowdown` times as long."""
    for row in rows:
        result = measurement(row.configuration)
        objectives = result.objectives | {"runtime": slowdown * result.objectives["runtime"]}
        record(row, replace(result, objectives=objectives))


def run(exploration: Exploration, slow_from: int | None = None) -> None:
    """Measure to the end, three times slower from the round that begins with number `slow_from` or later."""
    while waiting := services.pending_evaluations(exploration) or services.advance(exploration.pk):
        slow = slow_from is not None and waiting[0].number >= slow_from
        measure(waiting, 3.0 if slow else 1.0)
    exploration.refresh_from_db()


def outcome(exploration: Exploration) -> tuple[dict[str, set[float]], list[dict[str, Any]]]:
    """The ratios by configuration, and the configurations on the front."""
    ratios: dict[str, set[float]] = {}
    for row in exploration.evaluations.filter(state="done"):
        assert row.objectives is not None
        ratios.setdefault(row.configuration_key, set()).add(round(row.objectives["runtime_ratio"], 9))
    seen = watch(exploration.pk)
    assert seen is not None
    return ratios, [point.configuration for point in results_of(seen).front]


def test_a_host_that_becomes_three_times_slower_changes_no_speedup_and_no_front(
    comparing: Exploration,
) -> None:
    steady = services.create(services.clone(comparing))
    run(steady)

    run(comparing, slow_from=MIDDLE)

    ratios, front = outcome(comparing)
    assert (ratios, front) == outcome(steady)
    assert all(len(values) == 1 for values in ratios.values())
    runtimes = {
        row.objectives["runtime"] for row in comparing.evaluations.filter(label="default") if row.objectives
    }
    assert max(runtimes) == pytest.approx(3 * min(runtimes))
    speedups = [
        points.speedup(points.default_point(rows), rows[-1])
        for rows in (points.measured_points(each.evaluations.all()) for each in (comparing, steady))
    ]
    assert speedups[0] == pytest.approx(speedups[1])


def test_a_configuration_that_loses_more_frames_than_the_default_is_on_no_front(
    comparing: Exploration,
) -> None:
    while waiting := services.pending_evaluations(comparing) or services.advance(comparing.pk):
        for row in waiting:
            lost = 3 if row.configuration["integration_rate"] >= 20 else 1
            found = measured_on(row)
            record(row, replace(found, parts=tuple(part | {"lost": lost} for part in found.parts)))
    comparing.refresh_from_db()

    lossy = [row for row in comparing.evaluations.all() if row.configuration["integration_rate"] >= 20]
    assert {row.objectives["lost_more"] for row in lossy if row.objectives} == {2.0}
    _, front = outcome(comparing)
    assert front
    assert all(configuration["integration_rate"] < 20 for configuration in front)
    document = publishing.front_document(comparing, "7")
    assert all(point["parameters"]["integration_rate"] < 20 for point in document["configurations"])


def test_each_round_begins_with_the_default_which_costs_no_budget_and_adds_no_result(
    comparing: Exploration,
) -> None:
    measure(services.pending_evaluations(comparing))

    asked = services.advance(comparing.pk)

    assert [row.phase for row in asked] == ["default", *["random"] * 4]
    assert asked[0].label == "default"
    measure(asked)
    second = services.advance(comparing.pk)
    assert [row.phase for row in second] == ["default", "random", "random"]
    explorer = search.informed_explorer(comparing, search.read_rows(comparing))
    assert all(len(values) == 1 for values in explorer.history.results.values())


def test_the_search_learns_the_noise_from_the_defaults_rounds_and_not_from_a_step(
    comparing: Exploration,
) -> None:
    for slowdown in (1.0, 1.04, 3.0):
        measure(services.pending_evaluations(comparing) or services.advance(comparing.pk), slowdown)

    [default, *_] = search.read_rows(comparing)
    explorer = search.informed_explorer(comparing, search.read_rows(comparing))
    assert default.objectives is not None
    assert explorer.history.rounds == [pytest.approx((default.objectives["ate_max"], 1.04))]


def test_a_default_that_fails_in_a_round_is_replaced_by_the_nearest_one(comparing: Exploration) -> None:
    measure(services.pending_evaluations(comparing))
    default, *others = services.advance(comparing.pk)
    record(default, "no memory")
    measure(others)

    assert services.advance(comparing.pk)

    row = Evaluation.objects.get(pk=others[0].pk)
    given = comparing.evaluations.get(phase="given", label="default")
    assert row.objectives is not None
    assert given.objectives is not None
    expected = row.objectives["runtime"] / given.objectives["runtime"]
    assert row.objectives["runtime_ratio"] == pytest.approx(expected)


def test_without_any_default_it_pauses_and_goes_on_once_that_is_measured(comparing: Exploration) -> None:
    default, *others = services.pending_evaluations(comparing)
    record(default, "no memory")
    measure(others)

    assert services.advance(comparing.pk) == []

    comparing.refresh_from_db()
    assert comparing.state == "paused"
    assert "the default configuration could not be measured" in comparing.note
    assert "no memory" in comparing.note
    assert services.retry_failures(comparing) == 1
    services.resume(comparing)
    measure(services.pending_evaluations(comparing))
    assert services.advance(comparing.pk)


def test_rows_wait_for_the_default_of_their_round(comparing: Exploration) -> None:
    Exploration.objects.filter(pk=comparing.pk).update(synchronous=False)
    measure(services.pending_evaluations(comparing))
    default, *others = services.advance(comparing.pk)
    measure(others)

    services.advance(comparing.pk)

    comparing.refresh_from_db()
    assert Evaluation.objects.get(pk=others[0].pk).ratio_filled_at is None
    explorer = search.informed_explorer(comparing, search.read_rows(comparing))
    assert others[0].index in explorer.history.waiting()
    measure([default, *services.pending_evaluations(comparing)[1:]])
    services.advance(comparing.pk)
    assert Evaluation.objects.get(pk=others[0].pk).ratio_filled_at is not None


def test_copies_have_the_ratio_to_their_sources_default(exploration: Exploration) -> None:
    finish(services.pending_evaluations(exploration))  # an earlier one that minimises seconds

    warm = services.create(
        services.clone(exploration, objectives=["ate_max", "runtime_ratio"], warm_start_from=exploration)
    )

    default = warm.evaluations.get(phase="known", label="default")
    assert default.objectives is not None
    assert default.objectives["runtime_ratio"] == 1.0


def test_copies_get_the_ratio_of_errors_beside_a_stored_ratio_of_runtimes(comparing: Exploration) -> None:
    run(comparing)
    for row in comparing.evaluations.filter(state="done"):  # as a former program stored them
        row.objectives.pop("ate_max_ratio")
        row.objectives["runtime_ratio"] *= 2
        row.save(update_fields=["objectives"])

    changes = {"objectives": ["ate_max_ratio", "runtime_ratio"], "limits": {}}
    warm = services.create(services.clone(comparing, warm_start_from=comparing, **changes))

    for copy in warm.evaluations.filter(phase="known"):
        assert copy.copied_from is not None
        assert copy.objectives["ate_max_ratio"] > 0
        assert copy.objectives["runtime_ratio"] == copy.copied_from.objectives["runtime_ratio"]


def test_a_machine_that_reports_a_ratio_is_not_believed(comparing: Exploration) -> None:
    row = services.pending_evaluations(comparing)[0]
    result = measurement(row.configuration)
    record(row, replace(result, objectives=result.objectives | {"runtime_ratio": 0.001}))

    row.refresh_from_db()
    assert row.objectives is not None
    assert "runtime_ratio" not in row.objectives


def test_a_page_notices_a_ratio_that_is_filled_in_later(comparing: Exploration) -> None:
    measure(services.pending_evaluations(comparing))
    before = watch(comparing.pk)
    assert before is not None
    assert not results_of(before).front

    services.advance(comparing.pk)

    after = watch(comparing.pk)
    assert after is not None
    assert (after.results == before.results, after.version == before.version) == (False, False)
    assert results_of(after).front


def test_points_measured_again_on_demand_bring_their_default(comparing: Exploration) -> None:
    run(comparing)
    point = next(row for row in points.measured_points(comparing.evaluations.all()) if not row.label)

    new = services.measure_again(comparing, [(point.configuration, "")], 2)

    assert [row.label for row in new] == ["default", "", "default", ""]


def test_the_published_speedup_comes_from_the_ratio(comparing: Exploration) -> None:
    run(comparing, slow_from=MIDDLE)

    document = publishing.front_document(comparing, "1")

    predicted = {row["name"]: row["predicted"] for row in document["configurations"]}
    assert predicted["default"]["runtime_ratio"] == 1.0
    assert predicted["best"]["runtime_ratio"] < 1.0
    assert "runtime_ratio" in document["provenance"]["protocol"]


def test_a_limit_on_the_ratio_is_a_plain_number(unsaved: Exploration) -> None:
    unsaved.objectives, unsaved.limits = ["ate_max", "runtime_ratio"], {"runtime_ratio": 0.5}
    assert services.create(unsaved).limits == {"runtime_ratio": 0.5}

    with pytest.raises(ValidationError):
        services.validate(services.clone(unsaved, limits={"runtime_ratio": "half"}))
