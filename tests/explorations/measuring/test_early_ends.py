"""Results over HTTP of runs that ended early, as the search asked for."""

from typing import Any

import pytest

from crowd.explorations import services
from crowd.explorations.measuring import leases
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.searching import batches, search
from pareto import Censored
from tests.builders.explorations import measurement, run_to_the_end
from tests.explorations.measuring.test_leases import Board, board, done, problem

__all__ = ["board"]


def searched_lease(board: Board) -> tuple[dict[str, Any], Evaluation]:
    """The lease of the first configuration that the search asks for."""
    for row in services.pending_evaluations(Exploration.objects.get()):
        lease = board.take()
        assert row.pk == int(lease["id"].partition("-")[0])
        board.post(f"/{lease['id']}/result", done(lease) | {"configuration": lease["configuration"]})
    services.advance(Exploration.objects.get().pk)
    lease = board.take()
    return lease, Evaluation.objects.get(pk=lease["id"].partition("-")[0])


def stopped(lease: dict[str, Any], frames: int, error: float) -> dict[str, Any]:
    result = done(lease)
    objectives = result["objectives"] | {"ate_max": error}
    parts = [{"sequence": "tiny", "lost": 0, "stopped_at": frames, "objectives": objectives}]
    return result | {"objectives": objectives, "parts": parts}


def test_only_what_the_search_asks_for_may_end_early(board: Board) -> None:
    lease, row = searched_lease(board)

    assert row.phase in ("random", "active")
    assert lease["stop_above"] == [{"ate_max": 0.05}]
    assert Evaluation.objects.get(label="default").stop_above == []


def test_a_result_that_ended_early_is_a_bound_that_the_search_learns(board: Board) -> None:
    lease, row = searched_lease(board)

    answer = board.post(f"/{lease['id']}/result", stopped(lease, 31, 0.06))

    assert answer.json() == {"state": "done"}
    row.refresh_from_db()
    assert "ate_max" in row.censored
    assert "runtime" not in row.censored
    assert [part["stopped_at"] for part in row.parts or []] == [31]
    explorer = search.informed_explorer(row.exploration, search.read_rows(row.exploration))
    [values] = explorer.history.results[row.index]
    assert [isinstance(value, Censored) for value in values or ()] == [True, False]


@pytest.mark.parametrize(("frames", "error"), [(24, 0.06), (31, 0.05)])
def test_a_result_that_ended_without_a_reason_is_refused(board: Board, frames: int, error: float) -> None:
    lease, row = searched_lease(board)

    answer = board.post(f"/{lease['id']}/result", stopped(lease, frames, error))

    assert problem(answer) == (400, "invalid_field")
    row.refresh_from_db()
    assert row.state == "running"


def test_a_finished_point_ends_those_behind_it_once_noise_is_known(exploration: Exploration) -> None:
    run_to_the_end(exploration)
    row = exploration.evaluations.filter(phase="random", state="done").first()
    assert row is not None
    batches.add_evaluations(exploration, [(row.configuration, Evaluation.Phase.AGAIN, "")])
    [again] = services.pending_evaluations(exploration)
    assert again.stop_above == []
    Exploration.objects.update(state="running")
    with leases.leased(again.pk) as leased:
        assert leased is not None
        leases.record(leased, measurement(row.configuration))

    history = search.informed_explorer(exploration, search.read_rows(exploration)).history
    conditions = search.stop_conditions(exploration, history)

    assert conditions[0] == {"ate_max": 0.05}
    assert {frozenset(one) for one in conditions[1:]} == {frozenset({"ate_max", "runtime"})}
