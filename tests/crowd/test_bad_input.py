"""Every bad request is its own clear problem, and leaves nothing behind."""

import gzip
import json
import zlib
from collections.abc import Callable
from typing import Any

import pytest
from django.test import Client, RequestFactory
from django.urls import get_resolver

from crowd.devices.models import DeviceDescription, DeviceModel
from crowd.fronts.services import publish_content
from crowd.results.models import MeasurementSession, Run, Submission
from tests.crowd.documents import (
    device_document,
    front_document,
    run_document,
    session_document,
    submission_document,
)
from tests.crowd.participant import API, Participant


def nothing_is_stored() -> bool:
    return not any(
        model.objects.exists()
        for model in (Submission, MeasurementSession, Run, DeviceModel, DeviceDescription)
    )


def problem(response: Any) -> tuple[int, str, str | None]:
    """Status, code and field of a refusal, which must be problem+json and say something."""
    assert response.headers["Content-Type"] == "application/problem+json"
    document = response.json()
    assert document["status"] == response.status_code
    assert document["detail"]
    return response.status_code, document["code"], document.get("field")


def only(run: dict[str, Any]) -> dict[str, Any]:
    """A submission of this one run."""
    return submission_document(session_document() | {"runs": [run]})


def test_malformed_json(participant: Participant) -> None:
    assert problem(participant.submit(b'{"schema_version": 1,')) == (400, "malformed_json", None)
    assert problem(participant.submit(b"\xff\xfe{}")) == (400, "malformed_json", None)
    assert nothing_is_stored()


def test_json_nested_beyond_reason(participant: Participant) -> None:
    body = json.dumps(submission_document()).replace(
        '"os": "Android"', '"os": ' + "[" * 50_000 + "]" * 50_000
    )

    assert problem(participant.submit(body.encode())) == (400, "malformed_json", None)
    assert nothing_is_stored()


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"sessions": "none"}, "sessions"),
        ({"app_version": 1}, "app_version"),
        ({"device": ["Pixel"]}, "device"),
        ({"consent_version": "1"}, "consent_version"),
        ({"consent_version": True}, "consent_version"),
        ({"device": device_document(model=8)}, "device.model"),
        ({"device": device_document(opencl_device=["Mali-G715"])}, "device.opencl_device"),
    ],
)
def test_a_wrong_type_is_named(participant: Participant, changes: dict[str, Any], field: str) -> None:
    response = participant.submit(submission_document(**changes))

    assert problem(response) == (400, "invalid_field", field)
    assert nothing_is_stored()


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


def test_two_mebibytes_of_body(participant: Participant) -> None:
    body = json.dumps(submission_document(padding="x" * (2 << 20))).encode()

    assert problem(participant.submit(body)) == (413, "body_too_large", None)
    assert nothing_is_stored()


def test_a_gzip_bomb(participant: Participant) -> None:
    packer = zlib.compressobj(9, wbits=31)
    bomb = b"".join(packer.compress(b" " * (1 << 20)) for _ in range(100)) + packer.flush()
    assert len(bomb) < 1 << 20

    response = participant.submit(bomb, **{"Content-Encoding": "gzip"})

    assert problem(response) == (413, "inflated_too_large", None)
    assert nothing_is_stored()


@pytest.mark.parametrize("cut", [slice(None, -4), slice(4, None)])
def test_damaged_gzip(participant: Participant, cut: slice) -> None:
    body = gzip.compress(json.dumps(submission_document()).encode())[cut]

    assert problem(participant.submit(body, **{"Content-Encoding": "gzip"})) == (400, "damaged_gzip", None)
    assert nothing_is_stored()


def test_another_media_type_or_encoding(participant: Participant, client: Client) -> None:
    as_text = client.post(
        f"{API}/submissions", b"{}", content_type="text/plain",
        headers={**participant.headers, "Idempotency-Key": "a"},
    )  # fmt: skip

    assert problem(as_text) == (415, "unsupported_media_type", None)
    assert problem(participant.submit(b"{}", **{"Content-Encoding": "br"})) == (
        415,
        "unsupported_encoding",
        None,
    )


@pytest.mark.parametrize(
    ("headers", "code"),
    [
        ({}, "token_missing"),
        ({"Authorization": "Bearer nonsense"}, "token_invalid"),
        ({"Authorization": "Basic dXNlcjpwYXNz"}, "token_invalid"),
        ({"Authorization": "Bearer"}, "token_invalid"),
    ],
)
def test_a_bad_token(client: Client, front: Any, headers: dict[str, str], code: str) -> None:
    response = client.post(
        f"{API}/submissions", submission_document(), content_type="application/json", headers=headers
    )

    assert problem(response)[:2] == (401, code)
    assert response.headers["WWW-Authenticate"] == "Bearer"
    assert nothing_is_stored()


def test_a_missing_idempotency_key(participant: Participant) -> None:
    response = participant.submit(submission_document(), **{"Idempotency-Key": ""})

    assert problem(response) == (400, "idempotency_key_missing", "Idempotency-Key")
    assert nothing_is_stored()


def test_another_body_under_a_key_that_was_used(participant: Participant) -> None:
    participant.submit(submission_document(), key="a")

    assert problem(participant.submit(submission_document(), key="a"))[:2] == (409, "idempotency_key_reused")
    assert Run.objects.count() == 4


def test_a_refused_body_does_not_use_up_its_key(participant: Participant) -> None:
    participant.submit(b"{", key="a")

    assert participant.submit(submission_document(), key="a").status_code == 202


def test_an_unknown_schema_version(participant: Participant) -> None:
    response = participant.submit(submission_document(schema_version=2))

    assert problem(response) == (400, "unknown_schema_version", "schema_version")
    assert nothing_is_stored()


def test_an_outdated_program_is_told_to_update(participant: Participant, settings: Any) -> None:
    settings.FRONTRUNNER_MINIMUM_APP_VERSION = "0.10.0"

    assert problem(participant.submit(submission_document(app_version="0.9.9")))[:2] == (426, "app_outdated")
    assert problem(participant.submit(submission_document(app_version="new")))[2] == "app_version"
    assert nothing_is_stored()


def test_consent_to_another_text(participant: Participant) -> None:
    response = participant.submit(submission_document(consent_version=0))

    assert problem(response) == (400, "consent_outdated", "consent_version")
    assert nothing_is_stored()


@pytest.mark.parametrize(
    "member", ["serial", "IMEI", "host_name", "hostname", "macAddress", "user", "android_id"]
)
def test_what_could_identify_a_person(participant: Participant, member: str) -> None:
    response = participant.submit(submission_document(device=device_document() | {member: "x"}))

    assert problem(response) == (400, "personal_data", f"device.{member}")
    assert nothing_is_stored()


def test_what_could_identify_a_person_deeper_down(participant: Participant) -> None:
    device = device_document() | {"network": [{"mac": "00:00:5e:00:53:01"}]}

    assert problem(participant.submit(submission_document(device=device)))[:2] == (400, "personal_data")
    assert nothing_is_stored()


def test_a_nul_character(participant: Participant) -> None:
    response = participant.submit(submission_document(device=device_document(model="Pixel\0")))

    assert problem(response)[:2] == (400, "null_character")
    assert nothing_is_stored()


def test_a_device_that_tells_too_much(participant: Participant) -> None:
    response = participant.submit(submission_document(device=device_document(kernel="x" * 20_000)))

    assert problem(response) == (400, "device_too_large", "device")
    assert nothing_is_stored()


@pytest.mark.parametrize("depth", [20, 400])
def test_a_device_nested_beyond_reason(participant: Participant, depth: int) -> None:
    body = json.dumps(submission_document(device={"cpu_parts": "PARTS"}))
    body = body.replace('"PARTS"', "[" * depth + "]" * depth)

    assert problem(participant.submit(body.encode())) == (400, "device_too_deep", "device")
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

    response = join().submit(submission_document(session | {"runs": [run_document("best", 5, 5, 1)]}))

    assert problem(response)[:2] == (422, "session_taken")
    assert Run.objects.count() == 4


@pytest.mark.parametrize("other", [{"front_version": "kfusion-second"}, {"backend": "neon"}])
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


def test_a_closed_intake_asks_to_wait(participant: Participant, settings: Any) -> None:
    settings.FRONTRUNNER_ACCEPTING = False

    response = participant.submit(submission_document())

    assert problem(response)[:2] == (503, "not_accepting")
    assert int(response.headers["Retry-After"]) > 0
    assert nothing_is_stored()


def test_too_many_submissions_ask_to_wait(participant: Participant, settings: Any) -> None:
    settings.FRONTRUNNER_SUBMISSIONS_PER_MINUTE = 1
    participant.submit(submission_document(), key="a")

    response = participant.submit(submission_document())

    assert problem(response)[:2] == (429, "too_many_requests")
    assert int(response.headers["Retry-After"]) > 0
    assert Submission.objects.count() == 1


def test_an_address_that_is_none(client: Client) -> None:
    assert problem(client.get(f"{API}/nonsense"))[:2] == (404, "not_found")
    for method in (client.delete, client.options):
        response = method(f"{API}/speedups")
        assert problem(response)[:2] == (405, "method_not_allowed")
        assert response.headers["Allow"] == "GET, HEAD, OPTIONS"


@pytest.mark.parametrize("cursor", ["%FF", "%C3%A9", "a", "YWJj"])
def test_a_cursor_that_is_none(client: Client, front: Any, cursor: str) -> None:
    assert problem(client.get(f"{API}/speedups?cursor={cursor}")) == (400, "invalid_cursor", "cursor")


def test_a_host_that_is_not_served(client: Client) -> None:
    response = client.get(f"{API}/manifest", headers={"Host": "other.example"})

    assert problem(response)[:2] == (400, "bad_request")
    assert client.get("/", headers={"Host": "other.example"}).status_code == 400


def test_what_nobody_foresaw_is_a_problem_under_the_api_and_a_page_elsewhere(rf: RequestFactory) -> None:
    unforeseen = get_resolver().resolve_error_handler(500)

    assert unforeseen(rf.get(f"{API}/speedups")).headers["Content-Type"] == "application/problem+json"
    page = unforeseen(rf.get("/"))
    assert page.status_code == 500
    assert page.headers["Content-Type"].startswith("text/html")
