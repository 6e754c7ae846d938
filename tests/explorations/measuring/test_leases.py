"""Serving as a reference device over HTTP: leases, heartbeats, results."""

from datetime import timedelta
from typing import Any

import pytest
from django.test import Client
from django.utils import timezone

from crowd.api_pages.openapi import document as openapi
from crowd.explorations import services
from crowd.explorations.measuring import leases, reaping
from crowd.explorations.measuring.tokens import device_of_token, issue_token, revoke_token
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from crowd.explorations.searching import batches, search
from tests.builders.boards import API, CURRENT, Board, done, problem
from tests.builders.explorations import measurement, run_to_the_end


def test_a_lease_tells_all_that_a_measurement_needs(board: Board, exploration: Exploration) -> None:
    lease = board.take()

    row = Evaluation.objects.get(state="running")
    assert lease["id"] == f"{row.pk}-1"
    assert (lease["application"], lease["configuration"]) == ("kfusion", row.configuration)
    assert (lease["frames"], lease["backend"], lease["opencl_device"]) == (None, "opencl", "")
    [sequence] = lease["sequences"]
    assert sequence["sha256"] == exploration.sequence_sha256
    assert board.client.get(sequence["chunks"][0]["url"]).status_code == 200
    assert (row.worker, row.attempt) == ("board 7", 1)


def test_a_device_measures_one_thing_at_a_time_on_each_of_its_machines(
    board: Board, exploration: Exploration
) -> None:
    first = board.take()
    assert board.post("").status_code == 204

    device = exploration.reference_device
    device.machines = 2
    device.save()
    assert board.take()["id"] != first["id"]
    assert board.post("").status_code == 204


def test_a_result_is_stored_once_however_often_it_is_sent(board: Board) -> None:
    lease = board.take()

    answers = [board.send(lease, done(lease)) for _ in range(2)]

    assert [(answer.status_code, answer.json()) for answer in answers] == [(200, {"state": "done"})] * 2
    row = Evaluation.objects.get(state="done")
    assert row.objectives == measurement(lease["configuration"]).objectives
    assert (row.software, row.attempt) == ("client_kit 0.1.0", 1)


def test_a_result_of_another_configuration_is_not_taken_and_that_of_this_one_is(board: Board) -> None:
    lease = board.take()  # by this id, a database that was restored had another evaluation before
    mine = {**done(lease), "configuration": lease["configuration"]}
    other = {**mine, "configuration": {**lease["configuration"], "mu": 0.3125}}

    assert problem(board.send(lease, other)) == (410, "lease_gone")
    assert board.send(lease, mine).json() == {"state": "done"}
    assert problem(board.send(lease, other)) == (410, "lease_gone")
    assert board.send(lease, mine).json() == {"state": "done"}


def test_another_result_of_a_finished_lease_is_refused(board: Board) -> None:
    lease = board.take()
    mine = done(lease)
    board.send(lease, mine)
    other = {**mine, "objectives": mine["objectives"] | {"runtime": 2 * mine["objectives"]["runtime"]}}

    assert problem(board.send(lease, other)) == (409, "another_result")
    assert problem(board.send(lease, {"status": "failed", "error": "killed"})) == (409, "another_result")
    assert board.send(lease, mine).json() == {"state": "done"}


IMPOSSIBLE = [
    ({"runtime": 1e-9}, {}, None, "runtime is 1e-09 s a frame: give 5e-05 to"),
    ({"runtime": 1e308}, {}, None, "runtime is 1e+308 s"),
    ({"runtime": 0.02, "runtime_max": 0.01}, {}, None, "runtime is 0.02 s, longer than the"),
    ({"runtime_p95": 0.3, "runtime_max": 0.2}, {}, None, "runtime_p95 is 0.3 s, longer"),
    ({"ate_max": 1e308}, {}, None, "ate_max is 1e+308 m, beyond the volume of"),
    ({"runtime": 0.1}, {"tracking": 0.2}, None, "the stages take 0.2 s a frame"),
    ({}, {}, "9.9.9-not-a-version", "software is '9.9.9-not-a-version': give a version from"),
    ({}, {}, "whatever", "software is 'whatever'"),
]


def test_what_no_device_can_measure_is_refused_and_the_lease_stays(
    board: Board, subtests: pytest.Subtests
) -> None:
    lease = board.take()
    plain = done(lease)

    for objectives, stages, software, detail in IMPOSSIBLE:
        with subtests.test(detail):
            changes = {"objectives": plain["objectives"] | objectives, "stages": stages}
            answer = board.send(lease, plain | changes | {"software": software or plain["software"]})

            assert problem(answer) == (400, "invalid_field")
            assert detail in answer.json()["detail"]
            assert Evaluation.objects.get(state="running").objectives is None


def with_runtime(lease: dict[str, Any], seconds: float) -> dict[str, Any]:
    """A result of `lease` that takes `seconds` a frame."""
    return done(lease, runtime=seconds) | {"stages": {"preprocessing": seconds / 2, "tracking": seconds / 2}}


@pytest.mark.parametrize("default_last", [False, True])
def test_a_speedup_over_the_default_that_no_work_allows_is_refused(
    board: Board, exploration: Exploration, default_last: bool
) -> None:
    ReferenceDevice.objects.update(machines=2)
    default, other = board.take(), board.take()
    results = [(default, with_runtime(default, 1.0)), (other, with_runtime(other, 1e-4))]
    first, second = results[::-1] if default_last else results

    assert board.send(*first).json() == {"state": "done"}
    refused = board.send(*second)

    assert problem(refused) == (400, "invalid_field")
    assert f"{exploration} #1 is 1e+04 times as fast as the default on tiny" in refused.json()["detail"]
    if not default_last:
        assert board.send(other, with_runtime(other, 0.5)).json() == {"state": "done"}


def test_stages_beside_the_computation_may_take_any_time(board: Board) -> None:
    lease = board.take()
    result = done(lease)
    result["stages"] |= {"acquisition": 9.0, "total": 9.5}

    assert board.send(lease, result).json() == {"state": "done"}


def test_a_failure_keeps_its_reason_and_what_is_returned_waits_again(board: Board) -> None:
    lease = board.take()
    board.send(lease, {"status": "returned"})
    again = board.take()
    assert again["id"] == lease["id"].replace("-1", "-2")

    board.send(again, {"status": "failed", "error": "killed by SIGSEGV"})

    row = Evaluation.objects.get(state="failed")
    assert (row.error, row.attempt) == ("killed by SIGSEGV", 2)


def test_a_heartbeat_extends_the_lease_and_a_lease_that_is_gone_is_an_error(board: Board) -> None:
    lease = board.take()
    soon = timezone.now() + timedelta(seconds=1)
    Evaluation.objects.filter(state="running").update(lease_until=soon)

    assert board.post(f"/{lease['id']}/heartbeat").json()["lease_seconds"] == 90
    assert Evaluation.objects.get(state="running").lease_until > soon

    Evaluation.objects.filter(state="running").update(attempt=2)  # someone else took it over
    assert problem(board.post(f"/{lease['id']}/heartbeat")) == (410, "lease_gone")
    assert problem(board.send(lease, done(lease))) == (410, "lease_gone")
    assert not Evaluation.objects.filter(state="done").exists()


def test_a_result_that_was_never_leased_is_not_taken(board: Board, exploration: Exploration) -> None:
    waiting = exploration.evaluations.first()
    assert waiting is not None
    lease = {"configuration": waiting.configuration}

    assert problem(board.post(f"/{waiting.pk}-0/result", done(lease))) == (410, "lease_gone")
    assert not Evaluation.objects.filter(state="done").exists()


def measured_twice(board: Board, **changes: float) -> tuple[ReferenceDevice, Evaluation]:
    """The device after a configuration was measured again, unmarked, with `changes` of what it said first."""
    first = board.take()
    board.send(first, done(first))
    row = Evaluation.objects.get(state="done")
    exploration, pending = row.exploration, Evaluation.objects.filter(state="pending")
    pending.delete()
    (twin,) = batches.add_evaluations(exploration, [(row.configuration, Evaluation.Phase.CHECK, "")])
    again = board.take()
    assert {name for name in first if first[name] != again[name]} == {"id"}
    assert board.send(again, done(again, **changes) | {"stages": {}}).status_code == 200
    twin.refresh_from_db()
    return ReferenceDevice.objects.get(), twin


@pytest.mark.parametrize(("name", "value"), [("runtime", 0.5), ("ate_max", 2.0)])
def test_a_device_whose_answers_contradict_is_set_aside(board: Board, name: str, value: float) -> None:
    device, twin = measured_twice(board, **{name: value})

    assert (twin.state, twin.objectives[name]) == ("done", value)  # type: ignore[index]
    assert f"its answers contradict: {twin} has {name} {value:g}" in device.set_aside
    assert device.set_aside in Exploration.objects.get().note
    refused = board.post("")
    assert problem(refused) == (403, "device_set_aside")
    assert name in refused.json()["detail"]
    ReferenceDevice.objects.update(set_aside="")
    assert board.post("").status_code in (201, 204)


def test_a_device_whose_answers_hardly_differ_goes_on(board: Board) -> None:
    device, _ = measured_twice(board, ate_max=0.03)

    assert device.set_aside == ""


def test_one_in_twenty_is_measured_again_where_answers_come_over_http(
    exploration: Exploration, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batches, "MEASURED_AGAIN", 1)
    run_to_the_end(exploration)
    assert not exploration.evaluations.filter(phase=Evaluation.Phase.CHECK).exists()
    searched = exploration.evaluations.filter(phase__in=("random", "active"))
    rows = search.read_rows(exploration)
    assert batches.measured_again(exploration, rows) == []

    issue_token(exploration.reference_device)
    again = batches.measured_again(exploration, rows)
    assert [configuration for configuration, _, _ in again] == [row.configuration for row in searched]
    monkeypatch.setattr(batches, "MEASURED_AGAIN", 20)
    assert len(batches.measured_again(exploration, rows)) < len(again)


def test_a_late_result_counts_while_nobody_else_has_begun(board: Board) -> None:
    lease = board.take()
    Evaluation.objects.filter(state="running").update(state="pending", lease_until=None)

    assert problem(board.post(f"/{lease['id']}/heartbeat")) == (410, "lease_gone")
    assert board.send(lease, done(lease)).status_code == 200
    assert Evaluation.objects.get(state="done").attempt == 1


GOOD = {"runtime": 0.1, "ate_max": 0.1}


MALFORMED: list[tuple[Any, str | None, str]] = [
    ({"status": "ready"}, "status", "ready"),
    ({"status": "done"}, "objectives", "lack runtime, ate_max"),
    ({"status": "done", "objectives": {"ate_max": 0.1}}, "objectives", "lack runtime"),
    ({"status": "done", "objectives": {"runtime": 0.1}}, "objectives", "lack ate_max"),
    ({"status": "done", "objectives": GOOD | {"runtime": "fast"}}, "objectives[...]", "`str`"),
    ({"status": "done", "objectives": GOOD | {"runtime": -0.1}}, "objectives[...]", ">= 0"),
    ({"status": "done", "objectives": GOOD | {"ate_max": -1}}, "objectives[...]", ">= 0"),
    ({"status": "done", "objectives": GOOD, "stages": {"tracking": -1}}, "stages[...]", ">= 0"),
    ({"status": "done", "objectives": GOOD, "device": {"name": ["x"]}}, "device[...]", "`array`"),
    ({"status": "done", "objectives": GOOD, "device": {"name": "x" * 501}}, "device[...]", "<= 500"),
    ({"status": "done", "objectives": GOOD, "device": dict.fromkeys(map(str, range(33)))}, "device", "<= 32"),
    ({"status": "failed", "error": "x" * 501}, "error", "<= 500"),
    ([], None, "`object`"),
]


def test_a_result_that_does_not_fit_is_refused_with_the_field_and_changes_nothing(
    board: Board, subtests: pytest.Subtests
) -> None:
    lease = board.take()

    for result, where, detail in MALFORMED:
        with subtests.test(str(result)[:80]):
            answer = board.send(lease, result)

            assert problem(answer) == (400, "invalid_field")
            assert answer.json().get("field") == where
            assert detail in answer.json()["detail"]
            assert Evaluation.objects.get(state="running").attempt == 1


def test_a_value_that_is_not_finite_is_refused(board: Board, subtests: pytest.Subtests) -> None:
    lease = board.take()

    for number in ("NaN", "Infinity", "1e999"):
        with subtests.test(number):
            body = f'{{"status": "done", "objectives": {{"runtime": {number}, "ate_max": 0.1}}}}'
            assert problem(board.send(lease, body)) == (400, "not_finite")
            assert Evaluation.objects.get(state="running").objectives is None


def test_a_body_that_is_too_large_is_not_read(board: Board, settings: Any) -> None:
    wish = {"worker": "x" * settings.FRONTRUNNER_MAX_BODY_BYTES}
    assert problem(board.post("", wish)) == (413, "body_too_large")
    assert not Evaluation.objects.filter(state="running").exists()


def test_why_a_machine_gives_back_is_noted(board: Board, exploration: Exploration) -> None:
    lease = board.take()

    board.send(lease, {"status": "returned", "error": "no OpenCL device here"})

    exploration.refresh_from_db()
    assert exploration.note == "a machine of bench cannot measure: no OpenCL device here"
    assert exploration.evaluations.get(attempt=1).losses == 0


def test_an_exploration_whose_sequence_the_server_lacks_keeps_no_other_from_being_measured(
    board: Board, exploration: Exploration
) -> None:
    other = services.create(services.clone(exploration))
    Exploration.objects.filter(pk=exploration.pk).update(sequence="gone")

    lease = board.take()
    board.send(lease, {"status": "returned"})

    assert not exploration.evaluations.exclude(attempt=0).exists()
    assert other.evaluations.filter(attempt=1).count() == 1
    services.cancel(other)
    assert problem(board.post("")) == (409, "sequence_missing")
    assert not exploration.evaluations.exclude(attempt=0).exists()


def test_a_token_is_shown_once_and_opens_one_device_alone(
    client: Client, exploration: Exploration, board: Board
) -> None:
    device = exploration.reference_device
    assert problem(client.post(API)) == (401, "token_missing")
    assert problem(Board(client, "guessed").post("")) == (401, "token_invalid")
    assert problem(board.post("", CURRENT | {"device": "other"})) == (403, "another_device")

    token = issue_token(device)
    assert token not in str(device.__dict__)
    assert token.isalnum(), "after --token, a token with a dash reads as an option"
    assert device_of_token(token) == device
    assert problem(board.post("")) == (401, "token_invalid")
    revoke_token(device)
    assert problem(Board(client, token).post("")) == (401, "token_invalid")


def test_nothing_is_leased_of_a_paused_exploration(board: Board, exploration: Exploration) -> None:
    services.pause(exploration)
    assert board.post("").status_code == 204
    assert board.post("").headers["Retry-After"] == "5"


@pytest.mark.parametrize("change", [{"lease_until": None}, {"exploration__state": "paused"}])
def test_what_has_changed_since_it_was_read_is_not_leased(
    change: dict[str, Any], exploration: Exploration, monkeypatch: pytest.MonkeyPatch
) -> None:
    [evaluation, *_] = services.pending_evaluations(exploration)
    Evaluation.objects.filter(pk=evaluation.pk).update(
        state=Evaluation.State.RUNNING, lease_until=timezone.now() - timedelta(seconds=1)
    )
    evaluation = Evaluation.objects.select_related(leases.DEVICE).get(pk=evaluation.pk)
    if "exploration__state" in change:
        Exploration.objects.update(state=change["exploration__state"])
    else:  # its holder, who was only late, has renewed the lease
        Evaluation.objects.filter(pk=evaluation.pk).update(lease_until=timezone.now() + timedelta(minutes=1))

    assert leases._lease(evaluation, "another") is None


def test_openapi_describes_leases() -> None:
    described = openapi()
    assert {API, API + "/{key}-{attempt}/heartbeat", API + "/{key}-{attempt}/result"} <= set(
        described["paths"]
    )
    assert {"Lease", "Result"} <= set(described["components"]["schemas"])


def test_a_server_that_starts_takes_nothing_from_workers_which_could_not_renew(board: Board) -> None:
    board.take()
    Evaluation.objects.update(lease_until=timezone.now() - timedelta(hours=1))
    leases.renew_all()
    reaping.reap()
    assert Evaluation.objects.get(state=Evaluation.State.RUNNING).worker == "board 7"
