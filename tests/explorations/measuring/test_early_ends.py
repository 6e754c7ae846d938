"""Results over HTTP of runs that ended early, as the search asked for."""

from typing import Any

from crowd.explorations import services
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.searching import batches, search
from pareto import Censored
from tests.builders.boards import Board, done, problem
from tests.builders.explorations import measurement, record


def searched_lease(board: Board) -> tuple[dict[str, Any], Evaluation]:
    """The lease of the first configuration that the search asks for."""
    for row in services.pending_evaluations(Exploration.objects.get()):
        lease = board.take()
        assert row.pk == int(lease["id"].partition("-")[0])
        board.send(lease, done(lease) | {"configuration": lease["configuration"]})
    services.advance(Exploration.objects.get().pk)
    lease = board.take()
    return lease, Evaluation.objects.get(pk=lease["id"].partition("-")[0])


def stopped(lease: dict[str, Any], frames: int, error: float) -> dict[str, Any]:
    result = done(lease, ate_max=error)
    return result | {"parts": [part | {"stopped_at": frames} for part in result["parts"]]}


def test_only_what_the_search_asks_for_may_end_early(board: Board) -> None:
    lease, row = searched_lease(board)

    assert row.phase in ("random", "active")
    assert lease["stop_above"] == [{"ate_max": 0.05}]
    assert Evaluation.objects.get(label="default").stop_above == []


def test_a_result_that_ended_early_is_a_bound_that_the_search_learns(board: Board) -> None:
    lease, row = searched_lease(board)

    answer = board.send(lease, stopped(lease, 31, 0.06))

    assert answer.json() == {"state": "done"}
    row.refresh_from_db()
    assert "ate_max" in row.censored
    assert "runtime" not in row.censored
    assert [part["stopped_at"] for part in row.parts or []] == [31]
    explorer = search.informed_explorer(row.exploration, search.read_rows(row.exploration))
    [values] = explorer.history.results[row.index]
    assert [isinstance(value, Censored) for value in values or ()] == [True, False]


def test_a_result_that_ended_without_a_reason_is_refused(board: Board) -> None:
    lease, row = searched_lease(board)

    for frames, error in ((24, 0.06), (31, 0.05)):
        answer = board.send(lease, stopped(lease, frames, error))
        assert problem(answer) == (400, "invalid_field"), frames

    row.refresh_from_db()
    assert row.state == "running"


def test_a_finished_point_ends_those_behind_it_once_noise_is_known(explored: Exploration) -> None:
    row = explored.evaluations.filter(phase="random", state="done").first()
    assert row is not None
    batches.add_evaluations(explored, [(row.configuration, Evaluation.Phase.AGAIN, "")])
    [again] = services.pending_evaluations(explored)
    assert again.stop_above == []
    Exploration.objects.update(state="running")
    record(again, measurement(row.configuration))

    history = search.informed_explorer(explored, search.read_rows(explored)).history
    conditions = search.stop_conditions(explored, history)

    assert conditions[0] == {"ate_max": 0.05}
    assert {frozenset(one) for one in conditions[1:]} == {frozenset({"ate_max", "runtime"})}
