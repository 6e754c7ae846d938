"""How an exploration goes on: what is asked, what is stored, and what happens when workers die."""

from datetime import timedelta
from typing import Any

import pytest
from django.core.exceptions import ValidationError
from django.db import IntegrityError, transaction
from django.db.models import Q
from django.utils import timezone

from crowd.explorations import services
from crowd.explorations.measuring import leases, reaping
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.searching import search
from groundwork import __version__
from pareto.errors import ObjectiveError
from tests.builders.explorations import finish, measurement, record, run_to_the_end

LONG_AGO = timedelta(hours=1)


def let_leases_run_out() -> None:
    Evaluation.objects.filter(state="running").update(lease_until=timezone.now() - LONG_AGO)


def test_the_known_configurations_come_first_then_the_search_then_repeats_round_by_round(
    exploration: Exploration,
) -> None:
    known = ["default", "fast1", "fast2", "fast3", "fast4"]
    assert [row.label for row in services.pending_evaluations(exploration)] == known

    run_to_the_end(exploration)

    rows = list(exploration.evaluations.all())
    assert [row.number for row in rows] == list(range(len(rows)))
    assert [row.phase for row in rows[5:11]] == ["random"] * 6
    repeats = rows[11:]
    assert {row.phase for row in repeats} == {"repeat"}
    first, second = repeats[: len(repeats) // 2], repeats[len(repeats) // 2 :]
    assert [row.configuration for row in first] == [row.configuration for row in second]
    assert [row.label for row in first][:5] == known
    assert (exploration.state, exploration.finished_at is None) == ("done", False)


def test_an_application_without_known_configurations_is_compared_with_its_spaces_default(
    unsaved: Exploration,
) -> None:
    unsaved.application = "other"
    [row] = services.pending_evaluations(services.create(unsaved))
    assert (row.label, row.configuration["volume_resolution"]) == ("default", 64)


@pytest.mark.slow
def test_no_configuration_is_searched_twice(exploration: Exploration) -> None:
    exploration.budget = 60
    exploration.save()

    run_to_the_end(exploration)

    searched = [row.configuration_key for row in exploration.evaluations.filter(phase="random")]
    assert len(searched) == len(set(searched)) == 60


def test_nothing_new_is_asked_while_something_is_unfinished(exploration: Exploration) -> None:
    first = services.pending_evaluations(exploration)
    finish(first[:-1])

    assert services.advance(exploration.pk) == []

    finish(first[-1:])
    assert len(services.advance(exploration.pk)) == 4
    assert services.advance(exploration.pk) == []


def test_of_two_who_ask_at_once_one_is_heard(exploration: Exploration) -> None:
    finish(services.pending_evaluations(exploration))
    late = Exploration.objects.get(pk=exploration.pk)
    seen = search.read_rows(late)

    assert len(services.advance(exploration.pk)) == 4
    assert services._ask_search(late, seen) == []
    assert exploration.evaluations.count() == 9


def test_a_budget_raised_while_it_is_asked_keeps_the_exploration_from_ending(
    exploration: Exploration,
) -> None:
    late, seen = _about_to_be_done(exploration)

    services.raise_budget(exploration, 8)

    assert services._ask_search(late, seen) == []
    exploration.refresh_from_db()
    assert (exploration.state, exploration.finished_at) == ("running", None)
    assert len(services.advance(exploration.pk)) == 2


def test_failures_retried_while_it_is_asked_keep_the_exploration_from_ending(
    exploration: Exploration,
) -> None:
    late, seen = _about_to_be_done(exploration, failing=True)

    assert services.retry_failures(exploration) == 1

    assert services._ask_search(late, seen) == []
    exploration.refresh_from_db()
    assert exploration.state == "running"
    run_to_the_end(exploration)
    assert exploration.state == "done"
    assert not exploration.evaluations.exclude(state="done").exists()


def _about_to_be_done(
    exploration: Exploration, failing: bool = False
) -> tuple[Exploration, list[Evaluation]]:
    """All is measured, and what somebody has read who is about to find that there is nothing more to do."""
    Exploration.objects.filter(pk=exploration.pk).update(repeats=0)
    exploration.refresh_from_db()
    while waiting := services.pending_evaluations(exploration):
        if failing:
            record(waiting.pop(), "no memory")
            failing = False
        finish(waiting)
        if exploration.evaluations.filter(phase="random").count() < exploration.budget:
            services.advance(exploration.pk)
    return Exploration.objects.get(pk=exploration.pk), search.read_rows(exploration)


@pytest.mark.parametrize(
    ("error", "reason"),
    [(ObjectiveError("runtime is missing"), "runtime is missing"), (ValueError(0), "ValueError: 0")],
)
def test_a_search_that_cannot_go_on_pauses_with_its_reason(
    exploration: Exploration, monkeypatch: pytest.MonkeyPatch, error: Exception, reason: str
) -> None:
    finish(services.pending_evaluations(exploration))

    def fail(*_: Any) -> None:
        raise error

    with monkeypatch.context() as broken:
        broken.setattr(search, "informed_explorer", fail)
        assert services.advance(exploration.pk) == []

    exploration.refresh_from_db()
    assert (exploration.state, exploration.note) == ("paused", f"the search cannot go on: {reason}")
    assert reaping.reap() == []  # no retry every minute
    services.resume(exploration)
    assert exploration.note == ""
    assert len(services.advance(exploration.pk)) == 4


def test_a_measured_evaluation_is_stored_whole(exploration: Exploration) -> None:
    row = services.pending_evaluations(exploration)[0]

    finish([row])

    row.refresh_from_db()
    expected = measurement(row.configuration)
    assert (row.state, row.attempt, row.error) == ("done", 1, "")
    assert (row.objectives, row.stages, row.device) == (expected.objectives, expected.stages, expected.device)
    assert row.software.startswith(f"{__version__}+")
    assert row.lease_until is None


def test_an_evaluation_is_measured_by_one_at_a_time(exploration: Exploration) -> None:
    row = services.pending_evaluations(exploration)[0]
    with leases.leased(row.pk) as mine:
        with leases.leased(row.pk) as theirs:
            assert theirs is None
        assert mine is not None
        leases.record(mine, measurement(mine.configuration))

    with leases.leased(row.pk) as again:
        assert again is None


def test_a_failed_measurement_keeps_its_reason_and_the_search_goes_on(exploration: Exploration) -> None:
    for row in services.pending_evaluations(exploration):
        record(row, "killed by SIGABRT: out of resources")

    row.refresh_from_db()
    assert (row.state, row.error) == ("failed", "killed by SIGABRT: out of resources")
    assert len(services.advance(exploration.pk)) == 4


def test_any_other_error_gives_the_evaluation_back(exploration: Exploration) -> None:
    row = services.pending_evaluations(exploration)[0]
    with pytest.raises(KeyboardInterrupt), leases.leased(row.pk):
        raise KeyboardInterrupt

    row.refresh_from_db()
    assert (row.state, row.lease_until) == ("pending", None)


def test_an_evaluation_whose_worker_died_is_given_to_another(exploration: Exploration) -> None:
    row = services.pending_evaluations(exploration)[0]
    with leases.leased(row.pk) as dead:
        assert dead is not None
        let_leases_run_out()
        assert [found.pk for found in reaping.reap()] == [exploration.pk]
        with leases.leased(row.pk) as alive:
            assert alive is not None
            assert not leases.renew(dead)
            assert not leases.record(dead, measurement(dead.configuration))
            assert not leases.fail(dead, "too late")
            assert leases.renew(alive)
            assert leases.record(alive, measurement(alive.configuration))

    row.refresh_from_db()
    assert (row.state, row.attempt) == ("done", 2)


def test_a_result_that_came_late_is_not_taken_for_work(
    exploration: Exploration, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = exploration.reference_device
    late, following = services.pending_evaluations(exploration)[:2]
    holder = leases.take(late.pk, "slow")
    assert holder is not None
    Evaluation.objects.filter(pk=late.pk).update(state="pending", lease_until=None)  # as the reaper does
    lease = leases._lease

    def recorded_meanwhile(evaluation: Evaluation, worker: str) -> Evaluation | None:
        leases.record(holder, measurement(holder.configuration))
        return lease(evaluation, worker)

    monkeypatch.setattr(leases, "_lease", recorded_meanwhile)

    taken = leases.take_next(device, "quick", Q(exploration=exploration))

    late.refresh_from_db()
    assert (late.state, late.attempt) == ("done", 1)
    assert taken is not None
    assert taken.pk == following.pk


def test_control_characters_of_a_reason_are_not_stored(exploration: Exploration) -> None:
    row = services.pending_evaluations(exploration)[0]
    record(row, "\x1b[31mkilled\x00 by\nSIGABRT")

    row.refresh_from_db()
    assert row.error == "[31mkilled by SIGABRT"


def test_a_lease_that_ran_out_may_be_taken_over_even_before_the_reaper_comes(
    exploration: Exploration,
) -> None:
    row = services.pending_evaluations(exploration)[0]
    with leases.leased(row.pk):
        let_leases_run_out()
        record(row, measurement(row.configuration))


def test_a_lease_from_before_the_clock_was_set_back_runs_out_in_its_time(
    exploration: Exploration, settings: Any
) -> None:
    held = leases.take(services.pending_evaluations(exploration)[0].pk, "lost")
    assert held is not None
    Evaluation.objects.filter(pk=held.pk).update(lease_until=timezone.now() + LONG_AGO)

    reaping.reap()
    held.refresh_from_db()
    seconds = settings.FRONTRUNNER_LEASE_SECONDS
    assert held.lease_until <= timezone.now() + timedelta(seconds=seconds)  # type: ignore[operator]
    assert held.state == "running"


def test_what_kills_its_worker_three_times_is_failed(exploration: Exploration) -> None:
    row = services.pending_evaluations(exploration)[0]
    Evaluation.objects.filter(pk=row.pk).update(
        state="running", losses=reaping.MAX_LOSSES - 1, lease_until=timezone.now() - LONG_AGO
    )

    reaping.reap()

    row.refresh_from_db()
    assert row.state == "failed"
    assert "lost 3 times" in row.error


def test_a_cancelled_exploration_measures_nothing_more(exploration: Exploration) -> None:
    services.cancel(exploration)

    with leases.leased(services.pending_evaluations(exploration)[0].pk) as evaluation:
        assert evaluation is None
    assert services.advance(exploration.pk) == []
    assert reaping.reap() == []


def test_the_default_method_learns_from_given_configurations_in_its_space(unsaved: Exploration) -> None:
    unsaved.method, unsaved.budget, unsaved.batch, unsaved.recheck = "bayesian", 50, 10, False
    exploration = run_to_the_end(services.create(unsaved))

    phases = set(exploration.evaluations.values_list("phase", flat=True))
    assert phases - {"again"} == {"given", "random", "active", "repeat"}
    explorer = search.informed_explorer(exploration, search.read_rows(exploration))
    assert len(explorer.history.results) == 50 - exploration.evaluations.filter(phase="again").count()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"objectives": ["speed"]}, "runtime, runtime_p95, runtime_max, runtime_ratio, ate_max"),
        ({"objectives": "runtime"}, "must be a list"),
        ({"objectives": []}, "cannot be blank"),
        ({"limits": {"power": 1}}, "'power'"),
        ({"limits": [1]}, "must map"),
        ({"method": "annealing"}, "not a valid choice"),
        ({"space": {"parameters": []}}, "at least one parameter"),
        ({"sequence": "elsewhere"}, "no pack elsewhere"),
        ({"sequence_sha256": "0" * 64}, "no pack tiny with digest 000000000000"),
        ({"budget": 0}, "greater than or equal to 1"),
    ],
)
def test_an_exploration_that_cannot_run_is_refused(
    unsaved: Exploration, change: dict[str, Any], message: str
) -> None:
    for name, value in change.items():
        setattr(unsaved, name, value)

    with pytest.raises(ValidationError, match=message):
        services.create(unsaved)
    assert not Exploration.objects.exists()


def test_the_database_refuses_rows_that_cannot_be(
    exploration: Exploration, subtests: pytest.Subtests
) -> None:
    rows = Evaluation.objects.filter(pk=services.pending_evaluations(exploration)[0].pk)
    for impossible in ({"state": "done"}, {"state": "running"}, {"state": "failed"}, {"number": 1}):
        with subtests.test(**impossible), pytest.raises(IntegrityError), transaction.atomic():
            rows.update(**impossible)
