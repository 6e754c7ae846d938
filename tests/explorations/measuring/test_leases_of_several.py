"""Leases over several sequences and of perturbed depth."""

import re
from typing import Any

import pytest
from django.test import Client

from crowd.explorations import services
from crowd.explorations.models import Evaluation, Exploration
from tests.builders.boards import Board, done, problem
from tests.builders.explorations import finish, measured_on, measurement, run_to_the_end


@pytest.fixture
def board(client: Client, several: Exploration) -> Board:
    """The device of an exploration over tiny, desk and attic, library held out."""
    return Board(client, services.create(several).reference_device)


def result(lease: dict[str, Any], *sequences: str, **errors: float) -> dict[str, Any]:
    """A result with parts of `sequences`, `errors` by sequence where they are not the usual ones."""
    values = measurement(lease["configuration"]).objectives
    parts = [
        {"sequence": name, "lost": 1, "objectives": values | {"ate_max": errors.get(name, values["ate_max"])}}
        for name in sequences
    ]
    return done(lease) | {"parts": parts}


def test_a_lease_tells_all_sequences_and_where_to_stop(board: Board) -> None:
    lease = board.take()

    assert [sequence["name"] for sequence in lease["sequences"]] == ["tiny", "desk", "attic"]
    assert lease["perturbation"] == 0
    assert (lease["stop_above"], lease["stop_after"]) == ([], 1)  # the default runs over all
    assert lease["learned_on"] == 3
    for sequence in lease["sequences"]:
        assert board.client.get(sequence["chunks"][0]["url"]).status_code == 200
    board.send(lease, result(lease, "tiny", "desk", "attic"))
    assert board.take()["stop_above"] == [{"ate_max": 0.05}]


def test_a_repeat_runs_over_those_held_out_too_and_changes_depth(board: Board) -> None:
    exploration = run_to_the_end(Exploration.objects.get())
    services.measure_again(exploration, [(lease_default(exploration), "default")], 1)

    lease = board.take()

    assert [sequence["name"] for sequence in lease["sequences"]] == ["tiny", "desk", "attic", "library"]
    assert (lease["perturbation"], lease["stop_above"], lease["learned_on"]) == (2, [], 3)


def lease_default(exploration: Exploration) -> dict[str, Any]:
    row = exploration.evaluations.get(number=0)
    return dict(row.configuration)


def test_the_parts_of_a_result_are_stored_and_its_error_is_the_worst(board: Board) -> None:
    lease = board.take()

    answer = board.send(lease, result(lease, "tiny", "desk", "attic", desk=0.04))

    assert answer.json() == {"state": "done"}
    row = Evaluation.objects.get(state="done")
    assert row.objectives is not None
    assert row.objectives["ate_max"] == 0.04
    assert [(part["sequence"], part["lost"]) for part in row.parts or []] == [
        *(("tiny", 1), ("desk", 1), ("attic", 1))
    ]
    assert not row.censored


def test_a_result_that_ended_early_is_censored(board: Board) -> None:
    finish(services.pending_evaluations(Exploration.objects.get())[:1])
    lease = board.take()

    answer = board.send(lease, result(lease, "tiny", "desk", desk=0.06))

    assert answer.json() == {"state": "done"}
    row = Evaluation.objects.get(pk=lease["id"].partition("-")[0])
    assert row.censored
    assert row.objectives is not None
    assert row.objectives["ate_max"] == 0.06


OTHER_PARTS: list[tuple[tuple[str, ...], dict[str, float], str]] = [
    ((), {}, "parts lack tiny, desk, attic: measure every sequence"),
    (("tiny",), {}, "parts lack desk, attic"),
    (("tiny", "desk"), {"tiny": 0.04, "desk": 0.05}, "parts lack attic"),  # not above the limit
    (("tiny", "desk", "attic", "library"), {}, "parts name library, which the lease does not"),
    (("tiny", "tiny"), {}, "parts name tiny, twice: .*one part for each of tiny, desk, attic"),
]


def test_parts_that_are_not_those_of_the_lease_are_refused(board: Board, subtests: pytest.Subtests) -> None:
    finish(services.pending_evaluations(Exploration.objects.get())[:1])
    lease = board.take()

    for sequences, errors, complaint in OTHER_PARTS:
        with subtests.test(complaint):
            answer = board.send(lease, result(lease, *sequences, **errors))

            assert problem(answer) == (400, "invalid_field")
            assert answer.json()["field"] == "parts"
            assert re.search(complaint, answer.json()["detail"])
            assert Evaluation.objects.get(state="running").parts is None


def test_a_part_that_does_not_fit_is_refused(board: Board, subtests: pytest.Subtests) -> None:
    lease = board.take()

    for part, detail in (
        ({"lost": -1}, ">= 0"),
        ({"objectives": {"runtime": 0.1}}, "objectives of tiny lack ate_max"),
        ({"objectives": {"runtime": 0.1, "ate_max": -1}}, ">= 0"),
        ({"sequence": 7}, "Expected `str`"),
    ):
        with subtests.test(str(part)):
            document = result(lease, "tiny", "desk", "attic")
            document["parts"][0] |= part

            answer = board.send(lease, document)

            assert problem(answer) == (400, "invalid_field")
            assert detail in answer.json()["detail"]


@pytest.mark.parametrize("asked", [{}, {"lease_version": 1}, {"lease_version": 3}])
def test_a_client_of_another_version_is_refused_and_given_nothing(
    board: Board, asked: dict[str, int]
) -> None:
    answer = board.post("", asked)

    assert problem(answer) == (409, "client_outdated")
    assert "update this client" in answer.json()["detail"]
    assert not Evaluation.objects.exclude(attempt=0).exists()


def test_without_a_held_out_sequence_the_search_goes_on_but_no_repeat(
    board: Board, several: Exploration
) -> None:
    exploration = Exploration.objects.get()
    Exploration.objects.update(held_out_sequences=[{"name": "cellar", "sha256": "0" * 64}])
    assert [sequence["name"] for sequence in board.take()["sequences"]] == ["tiny", "desk", "attic"]
    exploration.evaluations.update(state="done", objectives={"runtime": 1, "ate_max": 1}, lease_until=None)
    services.measure_again(exploration, [(lease_default(exploration), "default")], 1)

    answer = board.post("")

    assert problem(answer) == (409, "sequence_missing")
    assert "no pack cellar" in answer.json()["detail"]


def test_what_a_worker_without_a_lease_over_http_measures_is_the_same(board: Board) -> None:
    exploration = Exploration.objects.get()
    row = services.pending_evaluations(exploration)[0]

    finish([row])

    row.refresh_from_db()
    assert row.parts == list(measured_on(row).parts)
