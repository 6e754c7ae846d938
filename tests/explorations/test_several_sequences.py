"""Explorations over several sequences: errors are the worst, failures end early, some are held out."""

from dataclasses import replace
from typing import Any

import pytest
from django.core.exceptions import ValidationError

from crowd.dashboard.content.searches import outcome_of
from crowd.explorations import services
from crowd.explorations.measuring.measurement import Measurement
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.outcomes.watching import results_of, watch
from crowd.explorations.searching import points, ratios, search, warm_start
from pareto.fronts.censored import Censored
from tests.builders.explorations import SPACE, finish, measured_on, measurement, record, run_to_the_end

GOOD = {"compute_size_ratio": 2, "integration_rate": 2, "tracking_rate": 1, "volume_resolution": 64}
BAD = GOOD | {"compute_size_ratio": 4, "tracking_rate": 9}  # 7 cm on tiny already
MIDDLE = GOOD | {"compute_size_ratio": 4, "tracking_rate": 2}  # 1.6 cm on tiny, 3.3 on desk, 6.5 on attic


def random_row(exploration: Exploration, configuration: dict[str, Any]) -> Evaluation:
    """`configuration`, measured as one that the search asked for."""
    [row] = services.batches.add_evaluations(exploration, [(configuration, Evaluation.Phase.RANDOM, "")])
    finish([row])
    row.refresh_from_db()
    return row


def objectives_of(row: Evaluation) -> dict[str, float]:
    assert row.objectives is not None
    return row.objectives


def test_an_error_is_the_worst_and_a_runtime_the_mean_of_all_sequences(several: Exploration) -> None:
    row = random_row(services.create(several), GOOD)

    alone = measurement(GOOD).objectives
    assert row.parts is not None
    assert [part["sequence"] for part in row.parts] == ["tiny", "desk", "attic"]
    assert objectives_of(row)["ate_max"] == pytest.approx(4 * alone["ate_max"])
    assert objectives_of(row)["runtime"] == pytest.approx(alone["runtime"])
    assert not row.censored


def test_a_measurement_ends_as_soon_as_its_error_is_certain_to_break_the_limit(several: Exploration) -> None:
    row = random_row(services.create(several), BAD)

    assert row.parts is not None
    assert [part["sequence"] for part in row.parts] == ["tiny"]
    assert row.censored
    assert objectives_of(row)["ate_max"] == pytest.approx(measurement(BAD).objectives["ate_max"])


def test_a_failure_on_the_last_sequence_leaves_nothing_open(several: Exploration) -> None:
    row = random_row(services.create(several), MIDDLE)

    assert objectives_of(row)["ate_max"] > 0.05
    assert not row.censored


def test_a_quantile_ignores_the_worst_sequences(several: Exploration) -> None:
    several.error_quantile = 0.66
    exploration = services.create(several)

    middle, bad = random_row(exploration, MIDDLE), random_row(exploration, BAD)

    assert exploration.failures_allowed == 1
    assert objectives_of(middle)["ate_max"] == pytest.approx(2 * measurement(MIDDLE).objectives["ate_max"])
    assert bad.parts is not None
    assert [part["sequence"] for part in bad.parts] == ["tiny", "desk"]
    assert bad.censored
    # Of those run the second worst counts, which is the least that the counted one can be.
    assert objectives_of(bad)["ate_max"] == pytest.approx(measurement(BAD).objectives["ate_max"])


@pytest.mark.parametrize(("quantile", "allowed"), [(1.0, 0), (0.67, 0), (0.66, 1), (0.34, 1), (0.01, 2)])
def test_a_quantile_allows_so_many_failures(several: Exploration, quantile: float, allowed: int) -> None:
    several.error_quantile = quantile
    assert several.failures_allowed == allowed


def test_repeats_run_over_all_sequences_and_those_held_out_with_perturbed_depth(several: Exploration) -> None:
    exploration = run_to_the_end(services.create(several))

    assert exploration.state == "done"
    repeats = exploration.evaluations.filter(phase="repeat").order_by("number")
    assert {tuple(part["sequence"] for part in row.parts or []) for row in repeats} == {
        ("tiny", "desk", "attic", "library")
    }
    assert not repeats.exclude(censored=[]).exists()
    for key in set(repeats.values_list("configuration_key", flat=True)):
        seeds = list(repeats.filter(configuration_key=key).values_list("perturbation", flat=True))
        assert seeds == [0, 1]
    row = repeats[0]
    assert objectives_of(row)["ate_max"] == pytest.approx(
        4 * measurement(row.configuration).objectives["ate_max"]
    )
    others = exploration.evaluations.exclude(phase="repeat")
    assert set(others.values_list("perturbation", flat=True)) == {0}


def test_further_repeats_go_on_with_the_next_perturbation(several: Exploration) -> None:
    exploration = run_to_the_end(services.create(several))

    default = exploration.evaluations.get(number=0)
    rows = services.measure_again(exploration, [(default.configuration, "default")], 2)

    assert [row.perturbation for row in rows] == [2, 3]


def test_the_search_gets_a_bound_and_never_puts_it_on_the_front(several: Exploration) -> None:
    exploration = services.create(several)
    row = random_row(exploration, BAD)

    explorer = search.informed_explorer(exploration, search.read_rows(exploration))

    [values] = explorer.history.results[row.index]
    assert isinstance(values[0], Censored)
    assert values[1] == pytest.approx(objectives_of(row)["runtime"])
    assert BAD not in [configuration for configuration, _ in explorer.front()]


def test_a_censored_measurement_is_on_no_front_and_not_valid_even_without_limits(
    several: Exploration,
) -> None:
    exploration = services.create(several)
    row = random_row(exploration, BAD)
    exploration.limits = {}

    measured = points.measured_points(exploration.evaluations.all())

    assert ["ate_max" in point.censored for point in measured] == [True]
    assert points.best_points(exploration, measured) == []
    Exploration.objects.filter(pk=exploration.pk).update(limits={"ate_max": 1.0})
    seen = watch(exploration.pk)
    assert seen is not None
    assert results_of(seen).points[0].censored
    assert not results_of(seen).front
    assert outcome_of(seen).valid == 0
    assert row.state == "done"


def test_what_was_measured_again_in_full_is_censored_no_more(several: Exploration) -> None:
    exploration = services.create(several)
    random_row(exploration, BAD)
    finish(services.measure_again(exploration, [(BAD, "")], 1))

    [point] = points.measured_points(exploration.evaluations.all())

    assert (point.repeats, point.censored) == (1, ())


def test_the_default_always_runs_over_all_sequences(several: Exploration) -> None:
    several.objectives = ["ate_max", "runtime_ratio"]
    several.limits = {"ate_max": 1e-6}
    exploration = services.create(several)

    finish(services.pending_evaluations(exploration))
    finish(services.advance(exploration.pk))
    services.advance(exploration.pk)

    defaults = exploration.evaluations.filter(label="default")
    assert [row.censored for row in defaults] == [[]] * len(defaults)
    assert all(row.stop_above == [] for row in defaults)
    others = exploration.evaluations.filter(phase="random", state="done")
    assert ["ate_max" in row.censored for row in others] == [True] * 4
    assert all("runtime_ratio" in objectives_of(row) for row in others)
    exploration.refresh_from_db()
    assert exploration.state == "running"


def test_ratios_compare_the_sequences_that_were_run(several: Exploration) -> None:
    several.objectives = ["ate_max", "runtime_ratio"]
    exploration = services.create(several)
    default = services.pending_evaluations(exploration)[0]
    result = measured_on(default)
    slow = [part | {"runtime": part["runtime"] * FACTOR[part["sequence"]]} for part in result.parts]
    record(default, replace(result, parts=tuple(slow)))
    [row] = services.batches.add_evaluations(exploration, [(BAD, Evaluation.Phase.RANDOM, "")], iteration=0)
    finish([row])
    finish(services.pending_evaluations(exploration))

    services.advance(exploration.pk)

    row.refresh_from_db()
    alone, compared = measurement(BAD).objectives, measurement(default.configuration).objectives
    assert row.censored
    assert objectives_of(row)["runtime_ratio"] == pytest.approx(alone["runtime"] / compared["runtime"])
    assert objectives_of(row)["ate_max_ratio"] == pytest.approx(alone["ate_max"] / compared["ate_max"])


FACTOR = {"tiny": 1.0, "desk": 3.0, "attic": 5.0}


def test_an_error_ratio_is_the_worst_of_the_sequences(several: Exploration) -> None:
    several.objectives = ["ate_max_ratio", "runtime_ratio"]
    several.limits = {}
    exploration = services.create(several)

    def parts(**errors: float) -> Measurement:
        rows = [{"sequence": name, "lost": 0, "runtime": 0.1, "ate_max": ate} for name, ate in errors.items()]
        return Measurement({"runtime": 0.1, "ate_max": 1.0}, {}, {}, tuple(rows))

    default, other, *rest = services.pending_evaluations(exploration)
    record(default, parts(tiny=0.01, desk=0.4, attic=0.0))
    record(other, parts(tiny=0.02, desk=0.4, attic=0.00015))
    finish(rest)

    services.advance(exploration.pk)

    other.refresh_from_db()
    assert objectives_of(other)["ate_max_ratio"] == pytest.approx(2.0)


def test_a_repeat_is_compared_with_a_default_of_the_search_where_no_repeat_of_it_was_measured(
    unsaved: Exploration, more_packs: dict[str, dict[str, str]]
) -> None:
    unsaved.objectives, unsaved.held_out_sequences = ["ate_max", "runtime_ratio"], [more_packs["library"]]
    exploration = services.create(unsaved)
    while not exploration.evaluations.filter(phase="repeat").exists():
        finish(services.pending_evaluations(exploration) or services.advance(exploration.pk))
        services.advance(exploration.pk)
    for row in services.pending_evaluations(exploration):
        if row.label == "default":
            record(row, "no memory")
    finish(services.pending_evaluations(exploration))

    found_ratios = ratios.compute_ratios(exploration, list(exploration.evaluations.all()))

    repeats = exploration.evaluations.filter(phase="repeat", state="done")
    assert repeats
    assert all(found_ratios[row.pk]["runtime_ratio"] > 0 for row in repeats)


def test_a_censored_measurement_is_no_outlier(several: Exploration, monkeypatch: pytest.MonkeyPatch) -> None:
    several.budget = several.batch = search.FIRST_LOOK
    exploration = services.create(several)
    finish(services.pending_evaluations(exploration))
    finish(services.advance(exploration.pk))
    looked: list[int] = []
    monkeypatch.setattr(search, "_deviations", lambda _, places, values: looked.extend(places) or values * 0)

    search.outliers(exploration, search.read_rows(exploration))

    censored = set(exploration.evaluations.exclude(censored=[]).values_list("index", flat=True))
    assert censored
    assert looked
    assert not censored & set(looked)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"further_sequences": [{"name": "cellar", "sha256": "0" * 64}]}, "no pack cellar with digest 0000"),
        ({"held_out_sequences": [{"name": "cellar", "sha256": "0" * 64}]}, "datasets make all"),
        ({"further_sequences": ["desk"]}, "give a list of {name, sha256}"),
        ({"further_sequences": [{"name": "desk"}]}, "give a list of {name, sha256}"),
        ({"error_quantile": 0.0}, "greater than or equal to 0.01"),
        ({"error_quantile": 1.5}, "less than or equal to 1"),
    ],
)
def test_sequences_that_cannot_be_measured_are_refused(
    several: Exploration, change: dict[str, Any], complaint: str
) -> None:
    with pytest.raises(ValidationError, match=complaint):
        services.create(services.clone(several, **change))


def test_a_sequence_is_named_once(several: Exploration, more_packs: dict[str, dict[str, str]]) -> None:
    for field in ("further_sequences", "held_out_sequences"):
        with pytest.raises(ValidationError, match="desk is named twice"):
            services.create(services.clone(several, **{field: [more_packs["desk"], more_packs["desk"]]}))


@pytest.mark.parametrize(
    ("change", "phase"),
    [
        ({}, "known"),
        ({"held_out_sequences": []}, "known"),
        ({"further_sequences": []}, "prior"),
        ({"error_quantile": 0.66}, "prior"),
    ],
)
def test_another_exploration_starts_from_measurements_on_the_same_sequences_alone(
    several: Exploration, change: dict[str, Any], phase: str
) -> None:
    exploration = services.create(several)
    bad = random_row(exploration, BAD)
    finish(services.measure_again(exploration, [(GOOD, "")], 2))

    copies = warm_start.copies(services.clone(exploration, **change), exploration)

    assert {row.phase for row in copies} == {phase}
    copy = next(row for row in copies if row.configuration == BAD)
    assert (copy.censored, copy.parts, copy.objectives) == (bad.censored, bad.parts, bad.objectives)
    assert [row.perturbation for row in copies if row.configuration == GOOD] == [0, 1]


def test_a_prior_keeps_its_bounds(several: Exploration) -> None:
    several.method = "bayesian"
    earlier = services.create(several)
    row = random_row(earlier, BAD)
    warm = services.create(services.clone(earlier, error_quantile=0.66, warm_start_from=earlier))

    explorer = search.informed_explorer(warm, search.read_rows(warm))

    [saved] = [values for index, _, [values] in explorer.state()["prior"] if index == row.index]
    assert saved == [{"censored": objectives_of(row)["ate_max"]}, objectives_of(row)["runtime"]]


def test_a_search_over_the_space_goes_on_with_failures(several: Exploration) -> None:
    several.method, several.budget, several.options = "bayesian", 10, {"initial": 4}
    exploration = run_to_the_end(services.create(several))

    assert (exploration.state, exploration.note) == ("done", "")
    assert exploration.evaluations.exclude(censored=[]).exists()
    seen = watch(exploration.pk)
    assert seen is not None
    assert results_of(seen).front
    assert all(point.values["ate_max"] <= 0.05 for point in results_of(seen).front)
    assert SPACE["name"] == exploration.space["name"]
