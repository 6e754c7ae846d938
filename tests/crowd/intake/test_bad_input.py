"""Every bad request is its own clear problem, and leaves nothing behind."""

import gzip
import json
import zlib
from typing import Any

import pytest
from django.test import Client, RequestFactory
from django.urls import get_resolver

from crowd.fronts.models import IntakePolicy
from crowd.results.models import Run, Submission
from tests.builders.documents import (
    device_document,
    submission_document,
)
from tests.builders.participant import API, Participant
from tests.crowd.refusals import nothing_is_stored, problem


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


def test_an_outdated_program_is_refused(participant: Participant) -> None:
    IntakePolicy.objects.create(minimum_app_version="0.10.0")

    assert problem(participant.submit(submission_document(app_version="0.9.9")))[:2] == (426, "app_outdated")
    assert problem(participant.submit(submission_document(app_version="new")))[2] == "app_version"
    assert nothing_is_stored()


def test_consent_to_another_text(participant: Participant) -> None:
    response = participant.submit(submission_document(consent_version=0))

    assert problem(response) == (400, "consent_outdated", "consent_version")
    assert nothing_is_stored()


@pytest.mark.slow
@pytest.mark.parametrize(
    "member",
    ["serial", "IMEI", "host_name", "macAddress", "user", "androidId", "gps_fix", "account", "nickname"],
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


@pytest.mark.parametrize("depth", [9, 14])
def test_a_device_nested_beyond_reason(participant: Participant, depth: int) -> None:
    body = json.dumps(submission_document(device={"cpu_parts": "PARTS"}))
    body = body.replace('"PARTS"', "[" * depth + "]" * depth)

    assert problem(participant.submit(body.encode())) == (400, "device_too_deep", "device")
    assert nothing_is_stored()


def test_a_closed_intake_asks_to_wait(participant: Participant) -> None:
    IntakePolicy.objects.create(accepting=False)

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
