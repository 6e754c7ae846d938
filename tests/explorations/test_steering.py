"""Pausing, cancelling, going further, cloning, starting warm, and measuring outliers again."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from django.core.exceptions import ValidationError

from crowd.explorations import services
from crowd.explorations.measuring import leases, reaping, workers
from crowd.explorations.measuring.measurement import Measurement
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from crowd.explorations.searching import search
from tests.builders.explorations import finish, measurement, record, run_to_the_end


def searched(exploration: Exploration) -> list[dict[str, Any]]:
    rows = exploration.evaluations.filter(phase__in=("random", "active")).order_by("number")
    return list(rows.values_list("configuration", flat=True))


def test_a_paused_exploration_finishes_what_runs_and_begins_nothing(exploration: Exploration) -> None:
    row, other = services.pending_evaluations(exploration)[:2]
    with leases.leased(row.pk) as evaluation:
        assert evaluation is not None
        services.pause(exploration)
        assert leases.record(evaluation, measurement(evaluation.configuration))
    assert leases.take(other.pk, "a worker") is None

    services.resume(exploration)

    assert leases.take(other.pk, "a worker") is not None


def test_cancelling_takes_the_lease_from_whoever_measures(exploration: Exploration) -> None:
    with leases.leased(services.pending_evaluations(exploration)[0].pk) as evaluation:
        assert evaluation is not None
        services.cancel(exploration)
        assert not leases.renew(evaluation)
    with pytest.raises(ValidationError, match="is cancelled: this needs the state paused"):
        services.resume(exploration)


def test_a_larger_budget_goes_on_as_if_it_had_been_given_at_first(unsaved: Exploration) -> None:
    whole = services.clone(unsaved, budget=12)
    first = run_to_the_end(services.create(unsaved))
    with pytest.raises(ValidationError, match="it is 6 already"):
        services.raise_budget(first, 6)

    services.raise_budget(first, 8)
    run_to_the_end(first)
    services.raise_budget(first, 12)
    run_to_the_end(first)

    # Batches of 4: those that the smaller budgets cut short were asked for at another time.
    assert len(searched(first)) == 12
    assert searched(first)[:4] == searched(run_to_the_end(services.create(whole)))[:4]
    assert first.state == "done"


def test_failures_are_measured_once_more(exploration: Exploration) -> None:
    row = services.pending_evaluations(exploration)[0]
    record(row, "no memory")
    assert services.retry_failures(exploration) == 1
    row.refresh_from_db()
    assert (row.state, row.error, row.attempt) == ("pending", "", 2)

    finish([row])

    row.refresh_from_db()
    assert (row.state, row.attempt) == ("done", 3)
    assert services.retry_failures(exploration) == 0


def test_whoever_was_given_up_does_not_fail_what_is_measured_once_more(exploration: Exploration) -> None:
    row = services.pending_evaluations(exploration)[0]
    given_up = leases.take(row.pk, "slow")
    assert given_up is not None
    Evaluation.objects.filter(pk=row.pk).update(state="failed", lease_until=None, error="lost 3 times")

    services.retry_failures(exploration)

    assert not leases.fail(given_up, "no memory")
    row.refresh_from_db()
    assert row.state == "pending"


def test_a_step_is_judged_by_the_row_as_it_is_now(exploration: Exploration) -> None:
    stale = Exploration.objects.get(pk=exploration.pk)
    services.raise_budget(exploration, 10)
    with pytest.raises(ValidationError, match="it is 10 already"):
        services.raise_budget(stale, 8)
    with pytest.raises(ValidationError, match="1000000 at most"):
        services.raise_budget(stale, 10**30)

    stale = Exploration.objects.get(pk=exploration.pk)
    run_to_the_end(exploration)
    services.raise_budget(stale, 12)

    exploration.refresh_from_db()
    assert (exploration.state, exploration.finished_at, exploration.budget) == ("running", None, 12)


def test_points_measured_again_run_over_the_whole_sequence_in_turn(unsaved: Exploration) -> None:
    unsaved.frames, unsaved.repeats = 11, 0
    exploration = run_to_the_end(services.create(unsaved))
    one, two = searched(exploration)[:2]

    rows = services.measure_again(exploration, [(one, ""), (two, "")], 2)

    assert exploration.state == "running"
    assert [row.configuration for row in rows] == [one, two, one, two]
    assert {(row.phase, row.frames) for row in rows} == {("repeat", None)}
    assert {row.frames for row in exploration.evaluations.exclude(phase="repeat")} == {11}
    assert run_to_the_end(exploration).state == "done"
    explorer = search.informed_explorer(exploration, search.read_rows(exploration))
    assert all(len(values) == 1 for values in explorer.history.results.values())


def test_a_clone_wishes_the_same_and_has_measured_nothing(explored: Exploration) -> None:

    other = services.create(services.clone(explored, seed=7))

    assert (other.seed, other.budget, other.state) == (7, explored.budget, "running")
    assert other.pk != explored.pk
    assert {row.state for row in other.evaluations.all()} == {"pending"}


def test_a_warm_start_knows_what_was_measured_and_does_not_measure_it_again(explored: Exploration) -> None:
    warm = services.create(services.clone(explored, warm_start_from=explored))

    known = warm.evaluations.filter(phase="known")
    assert known.count() == explored.evaluations.count()
    assert all(row.copied_from.objectives == row.objectives for row in known if row.copied_from)
    run_to_the_end(warm)

    assert len(searched(warm)) == warm.budget
    before = {str(configuration) for configuration in searched(explored)}
    assert not before & {str(configuration) for configuration in searched(warm)}


def test_another_devices_measurements_are_a_prior_and_never_a_measurement(explored: Exploration) -> None:
    board = ReferenceDevice.objects.create(name="board", queue="board")
    wishes = {"reference_device": board, "method": "bayesian", "warm_start_from": explored}
    warm = services.create(services.clone(explored, **wishes))

    assert warm.evaluations.filter(phase="prior").count() == explored.evaluations.count()
    explorer = search.informed_explorer(warm, search.read_rows(warm))
    assert not explorer.history.results
    assert explorer.state()["prior"]


def test_a_synchronous_search_is_the_same_however_often_it_is_interrupted(unsaved: Exploration) -> None:
    unsaved.method, unsaved.options, unsaved.budget = "bayesian", {"initial": 8}, 16
    calm = run_to_the_end(services.create(services.clone(unsaved)))

    stormy = services.create(unsaved)
    while waiting := services.pending_evaluations(stormy) or services.advance(stormy.pk):
        for row in reversed(waiting):  # another order of finishing
            assert leases.take(row.pk, "a worker that dies") is not None
            Evaluation.objects.filter(pk=row.pk).update(lease_until="2020-01-01T00:00Z")
            reaping.reap()
            finish([row])

    assert searched(stormy) == searched(calm)
    assert set(stormy.evaluations.values_list("attempt", flat=True)) == {2}


def test_a_prior_that_lacks_an_objective_is_refused_at_once(explored: Exploration) -> None:
    board = ReferenceDevice.objects.create(name="board", queue="board")
    wishes = {"reference_device": board, "method": "bayesian", "warm_start_from": explored}

    with pytest.raises(ValidationError, match="did not measure cpu_seconds: choose another one"):
        services.create(services.clone(explored, objectives=["runtime", "cpu_seconds"], limits={}, **wishes))


def test_the_queue_of_the_servers_own_tasks_serves_no_device(db: None) -> None:
    with pytest.raises(ValidationError, match="crowd is the queue of the server's own tasks"):
        ReferenceDevice(name="bench", queue="crowd").full_clean()


def test_an_asynchronous_search_asks_before_everything_is_finished(unsaved: Exploration) -> None:
    unsaved.synchronous, unsaved.batch = False, 4
    exploration = services.create(unsaved)
    finish(services.pending_evaluations(exploration)[:3])

    asked = services.advance(exploration.pk)

    assert len(asked) == 2
    assert services.unfinished_evaluations(exploration).count() == unsaved.batch
    assert services.advance(exploration.pk) == []
    assert run_to_the_end(exploration).state == "done"
    assert len(searched(exploration)) == exploration.budget


def test_an_outlier_is_measured_twice_more_and_the_median_counts(unsaved: Exploration) -> None:
    unsaved.budget, unsaved.batch, unsaved.points, unsaved.repeats = 50, 50, 2, 0
    exploration = services.create(unsaved)
    finish(services.pending_evaluations(exploration))
    rows = services.advance(exploration.pk)
    finish(rows[1:])
    disturbed = measurement(rows[0].configuration)
    slow = disturbed.objectives | {"runtime": 40 * disturbed.objectives["runtime"]}
    with leases.leased(rows[0].pk) as evaluation:
        assert evaluation is not None
        leases.record(evaluation, Measurement(slow, disturbed.stages, disturbed.device))

    checks = services.advance(exploration.pk)

    assert [row.configuration for row in checks].count(rows[0].configuration) == search.CHECKS
    assert len(checks) <= search.CHECKS * search.MAX_OUTLIER_SHARE * 50
    finish(checks)
    explorer = search.informed_explorer(exploration, search.read_rows(exploration))
    (values,) = explorer.history.results[rows[0].index or 0]
    assert values == (disturbed.objectives["ate_max"], disturbed.objectives["runtime"])
    assert run_to_the_end(exploration).evaluations.filter(phase="check").count() == len(checks)


def test_an_asynchronous_search_looks_for_outliers_at_50_and_at_100_once(
    unsaved: Exploration, monkeypatch: pytest.MonkeyPatch
) -> None:
    unsaved.synchronous, unsaved.budget, unsaved.batch, unsaved.repeats = False, 72, 6, 0
    monkeypatch.setattr(search, "FIRST_LOOK", 20)
    exploration = services.create(unsaved)
    looks: list[int] = []

    def far(_: Any, indices: Any, __: Any) -> Any:
        looks.append(exploration.evaluations.filter(phase="random").count())
        return np.zeros(len(indices))

    monkeypatch.setattr(search, "_deviations", far)
    while True:
        asked = services.advance(exploration.pk)
        waiting = services.pending_evaluations(exploration)
        if not asked and not waiting:
            break
        finish(waiting[-4:] if len(waiting) > 4 else waiting)  # the newest first: the oldest is late

    assert len(looks) == 2 * len(exploration.objectives)
    assert [20 <= looks[0] < 26, 40 <= looks[-1] < 46] == [True, True]


def test_a_busy_device_is_not_disturbed(exploration: Exploration) -> None:
    first, second = services.pending_evaluations(exploration)[:2]
    assert leases.take(first.pk, "one") is not None
    with pytest.raises(leases.DeviceBusyError, match="bench: all of its 1 machines are busy"):
        leases.take(second.pk, "another")


def test_what_a_dead_process_of_this_machine_held_is_given_back_at_once(
    exploration: Exploration, tmp_path: Path
) -> None:
    rows = services.pending_evaluations(exploration)[:3]
    exploration.reference_device.machines = 3
    exploration.reference_device.save()
    machine, _, pid = workers.worker_name().rpartition(":")
    other_start = f"{machine.partition(':')[0]}:another:{pid}"
    for row, worker in zip(rows, (workers.worker_name(), f"{machine}:999999999", other_start), strict=True):
        assert leases.take(row.pk, worker) is not None

    reaping.reap_after_restart()

    for row in rows:
        row.refresh_from_db()
    assert [(row.state, row.losses) for row in rows] == [("running", 0), ("pending", 1), ("pending", 1)]
