"""Every run and session that cannot be right is its own clear problem, and leaves nothing behind."""

import json
from collections.abc import Callable
from typing import Any

import pytest

from crowd.fronts.publishing.services import publish_content
from crowd.results.models import Run
from tests.builders.documents import (
    front_document,
    run_document,
    session_document,
    submission_document,
)
from tests.builders.participant import Participant
from tests.crowd.refusals import nothing_is_stored, only, problem


@pytest.mark.parametrize(
    ("member", "value"),
    [
        ("frame_us", "fast"),
        ("repeat", "first"),
        ("id", "not a UUID"),
        ("status", "great"),
        ("ate_max", "small"),
    ],
)
def test_a_wrong_type_in_the_only_run_is_named(participant: Participant, member: str, value: str) -> None:
    response = participant.submit(only(run_document("best", 0, 0, 1000, **{member: value})))

    assert problem(response) == (422, "invalid_field", f"sessions[0].runs[0].{member}")
    assert nothing_is_stored()


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity"])
def test_numbers_that_json_does_not_have(participant: Participant, number: str) -> None:
    body = json.dumps(submission_document()).replace("0.012", number, 1)

    assert problem(participant.submit(body.encode())) == (400, "not_finite", None)
    assert nothing_is_stored()


def test_an_infinite_number_costs_only_its_run(participant: Participant) -> None:
    body = json.dumps(submission_document()).replace("0.012", "1e999", 1)

    items = participant.submit(body.encode()).json()["items"]

    assert [item["code"] for item in items] == ["not_finite", None, None, None]


def test_a_whole_number_beyond_reason_is_not_called_infinite(participant: Participant) -> None:
    body = json.dumps(submission_document()).replace('"repeat": 0', f'"repeat": {"9" * 5_000}')

    items = participant.submit(body.encode()).json()["items"]

    assert [item["code"] for item in items] == ["invalid_field", "invalid_field", None, None]


def test_an_item_keeps_its_id_whatever_else_its_run_holds(participant: Participant) -> None:
    session = session_document()
    session["runs"][0]["later"] = 0.777
    body = json.dumps(submission_document(session)).replace("0.777", "1e999")

    items = participant.submit(body.encode()).json()["items"]

    assert [item["id"] for item in items] == [run["id"] for run in session["runs"]]


def test_a_sample_before_the_start(participant: Participant) -> None:
    response = participant.submit(submission_document(session_document(samples=[{"t": -1.0}])))

    assert problem(response) == (400, "invalid_field", "sessions[0].samples[0].t")
    assert nothing_is_stored()


def test_negative_times(participant: Participant) -> None:
    run = run_document("best", 0, 0, 1000)
    run["frame_us"][7] = -1

    assert problem(participant.submit(only(run))) == (422, "negative_time", "sessions[0].runs[0].frame_us")
    assert nothing_is_stored()


def test_negative_stage_times(participant: Participant) -> None:
    run = run_document("best", 0, 0, 1000)
    run["stages_us"]["tracking"][7] = -1

    assert problem(participant.submit(only(run)))[1:] == (
        "negative_time",
        "sessions[0].runs[0].stages_us.tracking",
    )
    assert nothing_is_stored()


@pytest.mark.parametrize("frames", [0, 99, 101])
def test_a_wrong_frame_count(participant: Participant, frames: int) -> None:
    run = run_document("best", 0, 0, 1000, frame_us=[1000] * frames)

    assert problem(participant.submit(only(run))) == (422, "frame_count", "sessions[0].runs[0].frame_us")
    assert nothing_is_stored()


def test_times_beyond_the_clock(participant: Participant) -> None:
    run = run_document("best", 0, 0, 1000, frame_us=[2**32] * 100)

    assert problem(participant.submit(only(run)))[1] == "time_too_large"
    assert nothing_is_stored()


@pytest.mark.parametrize("member", ["frame_us", "stages_us"])
def test_a_frame_takes_at_most_a_minute(participant: Participant, member: str) -> None:
    longest, longer = ([60_000_000 + more] + [1000] * 99 for more in (0, 1))
    times = {"frame_us": longest, "stages_us": {"tracking": longest}}
    taken = run_document("best", 0, 0, 1000, **times)
    refused = run_document("best", 1, 1, 1000)
    refused[member] = longer if member == "frame_us" else {"tracking": longer}

    items = participant.submit(submission_document(session_document(runs=[taken, refused]))).json()["items"]

    assert [item["code"] for item in items] == [None, "time_too_large"]


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["opencl", "webgpu", "wasm", "vulkan", "metal", "cuda", "cpu"])
def test_known_backends_are_taken(participant: Participant, backend: str) -> None:
    session = session_document(backend=backend, threads=1 if backend == "wasm" else None)

    assert participant.submit(submission_document(session)).status_code == 202


@pytest.mark.parametrize("backend", ["neon", "OpenCL", "buy-my-phone", ""])
def test_another_backend_is_refused(participant: Participant, backend: str) -> None:
    response = participant.submit(submission_document(session_document(backend=backend)))

    assert problem(response) == (400, "invalid_field", "sessions[0].backend")
    assert nothing_is_stored()


def test_a_clock_that_stands_still(participant: Participant) -> None:
    assert problem(participant.submit(only(run_document("best", 0, 0, 0))))[1] == "zero_time"
    assert nothing_is_stored()


def test_a_negative_error(participant: Participant) -> None:
    run = run_document("best", 0, 0, 1000, ate_max=-0.01)

    assert problem(participant.submit(only(run))) == (422, "negative_error", "sessions[0].runs[0].ate_max")
    assert nothing_is_stored()


def test_an_unknown_configuration(participant: Participant) -> None:
    response = participant.submit(only(run_document("fastest", 0, 0, 1000)))

    assert problem(response) == (422, "unknown_configuration", "sessions[0].runs[0].configuration")
    assert "accurate, best, default" in response.json()["detail"]
    assert nothing_is_stored()


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"front_version": "kfusion-99"}, "unknown_front_version"),
        ({"application": "elasticfusion"}, "unknown_front_version"),
        ({"protocol_version": 7}, "unknown_protocol_version"),
    ],
)
def test_a_session_of_nothing_that_is_published(
    participant: Participant, changes: dict[str, Any], code: str
) -> None:
    response = participant.submit(submission_document(session_document(**changes)))

    assert problem(response)[:2] == (422, code)
    assert [item["status"] for item in response.json()["items"]] == ["rejected"] * 4
    assert nothing_is_stored()


def test_a_session_without_a_time_zone(participant: Participant) -> None:
    response = participant.submit(submission_document(session_document(started_at="2026-11-20T10:17:00")))

    assert problem(response) == (400, "invalid_field", "sessions[0].started_at")
    assert nothing_is_stored()


@pytest.mark.parametrize("time", ["0001-01-01T00:00:00+12:00", "9999-12-31T23:59:59-12:00"])
def test_a_start_that_is_no_moment(participant: Participant, time: str) -> None:
    response = participant.submit(submission_document(session_document(started_at=time)))

    assert problem(response) == (422, "invalid_field", "sessions[0].started_at")
    assert nothing_is_stored()


def test_no_runs_and_too_many(participant: Participant) -> None:
    none = submission_document(session_document() | {"runs": []})
    many = submission_document(
        session_document() | {"runs": [run_document("best", n, n, 1000, stages_us={}) for n in range(51)]}
    )

    assert problem(participant.submit(none)) == (400, "run_count", "sessions")
    assert problem(participant.submit(many)) == (400, "run_count", "sessions")
    assert nothing_is_stored()


def test_two_runs_that_claim_one_repeat(participant: Participant) -> None:
    session = session_document()
    session["runs"].append(run_document("best", 1, 4, 1))

    items = participant.submit(submission_document(session)).json()["items"]

    assert [item["code"] for item in items] == [None, None, None, None, "repeat_taken"]


def test_a_repeat_that_is_stored_already(participant: Participant) -> None:
    session = session_document()
    participant.submit(submission_document(session))

    response = participant.submit(submission_document(session | {"runs": [run_document("best", 1, 4, 1)]}))

    assert problem(response)[:2] == (422, "repeat_taken")
    assert Run.objects.count() == 4


def test_a_session_of_somebody_else(participant: Participant, join: Callable[[], Participant]) -> None:
    session = session_document()
    participant.submit(submission_document(session))

    response = join().submit(submission_document(session | {"runs": [run_document("best", 1, 5, 1)]}))

    assert problem(response)[:2] == (422, "session_taken")
    assert Run.objects.count() == 4


@pytest.mark.parametrize("other", [{"front_version": "kfusion-second"}, {"backend": "vulkan"}])
def test_one_session_is_of_one_front_and_backend(
    participant: Participant, pack: dict[str, Any], other: dict[str, str]
) -> None:
    """Within one request as between two: runs of a session are compared with each other."""
    publish_content(front_document(pack, "second"))
    session = session_document()
    first, second = session | {"runs": session["runs"][:2]}, session | {"runs": session["runs"][2:]} | other

    items = participant.submit(submission_document(first, second)).json()["items"]
    later = participant.submit(submission_document(second))

    assert [item["code"] for item in items] == [None, None, "session_taken", "session_taken"]
    assert problem(later)[:2] == (422, "session_taken")
    assert Run.objects.count() == 2
    assert participant.get("/speedups?since=2020-01-01").status_code == 200


def test_a_session_that_is_refused_takes_no_id(participant: Participant) -> None:
    session = session_document()

    answer = participant.submit(submission_document(session | {"front_version": "kfusion-none"}, session))

    assert [item["code"] for item in answer.json()["items"]] == ["unknown_front_version"] * 4 + [None] * 4
    assert Run.objects.count() == 4
