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
from tests.builders.documents import device_document, submission_document
from tests.builders.participant import API, Participant
from tests.crowd.refusals import nested, nothing_is_stored, problem

PERSONAL = (
    "serial", "IMEI", "host_name", "macAddress", "user", "androidId", "gps_fix", "account", "nickname",
)  # fmt: skip
# What is wrong in a submission, and the code and the field of the refusal.
REFUSED: dict[str, tuple[dict[str, Any], str, str | None]] = {
    "another schema": ({"schema_version": 2}, "unknown_schema_version", "schema_version"),
    "sessions that are a text": ({"sessions": "none"}, "invalid_field", "sessions"),
    "a version that is a number": ({"app_version": 1}, "invalid_field", "app_version"),
    "a device that is a list": ({"device": ["Pixel"]}, "invalid_field", "device"),
    "consent that is a text": ({"consent_version": "1"}, "invalid_field", "consent_version"),
    "consent that is true": ({"consent_version": True}, "invalid_field", "consent_version"),
    "consent to another text": ({"consent_version": 0}, "consent_outdated", "consent_version"),
    "a model that is a number": ({"device": device_document(model=8)}, "invalid_field", "device.model"),
    "a chip that is a list": (
        {"device": device_document(opencl_device=["Mali-G715"])},
        "invalid_field",
        "device.opencl_device",
    ),
    "a NUL": ({"device": device_document(model="Pixel\0")}, "null_character", None),
    "a device that tells too much": (
        {"device": device_document(kernel="x" * 20_000)},
        "device_too_large",
        "device",
    ),
    "a deep device": ({"device": {"cpu_parts": nested(9)}}, "device_too_deep", "device"),
    "a deeper device": ({"device": {"cpu_parts": nested(14)}}, "device_too_deep", "device"),
    "a person deeper down": (
        {"device": device_document(network=[{"mac": "00:00:5e:00:53:01"}])},
        "personal_data",
        "device.network.mac",
    ),
    **{
        f"a person's {member}": (
            {"device": device_document(**{member: "x"})},
            "personal_data",
            f"device.{member}",
        )
        for member in PERSONAL
    },
}


@pytest.mark.parametrize(("changes", "code", "field"), REFUSED.values(), ids=REFUSED)
def test_a_wrong_member_is_named(
    participant: Participant, changes: dict[str, Any], code: str, field: str | None
) -> None:
    response = participant.submit(submission_document(**changes))

    assert problem(response) == (400, code, field)
    assert nothing_is_stored()


def gzip_bomb() -> bytes:
    packer = zlib.compressobj(9, wbits=31)
    bomb = b"".join(packer.compress(b" " * (1 << 20)) for _ in range(100)) + packer.flush()
    assert len(bomb) < 1 << 20
    return bomb


def document() -> bytes:
    return json.dumps(submission_document()).encode()


GZIP, BROTLI = {"Content-Encoding": "gzip"}, {"Content-Encoding": "br"}
UNREADABLE = {
    "cut off": (lambda: b'{"schema_version": 1,', {}, 400, "malformed_json"),
    "another encoding of texts": (lambda: b"\xff\xfe{}", {}, 400, "malformed_json"),
    "two mebibytes": (lambda: document() + b" " * (2 << 20), {}, 413, "body_too_large"),
    "a gzip bomb": (gzip_bomb, GZIP, 413, "inflated_too_large"),
    "gzip without its end": (lambda: gzip.compress(document())[:-4], GZIP, 400, "damaged_gzip"),
    "gzip without its start": (lambda: gzip.compress(document())[4:], GZIP, 400, "damaged_gzip"),
    "another packing": (lambda: b"{}", BROTLI, 415, "unsupported_encoding"),
    "another type of media": (document, {"Content-Type": "text/plain"}, 415, "unsupported_media_type"),
}


@pytest.mark.parametrize(("body", "headers", "status", "code"), UNREADABLE.values(), ids=UNREADABLE)
def test_a_body_that_cannot_be_read(
    participant: Participant, body: Any, headers: dict[str, str], status: int, code: str
) -> None:
    assert problem(participant.submit(body(), **headers)) == (status, code, None)
    assert nothing_is_stored()


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
    participant.submit(b"{", key="a")  # what is refused does not use up its key
    assert participant.submit(submission_document(), key="a").status_code == 202

    assert problem(participant.submit(submission_document(), key="a"))[:2] == (409, "idempotency_key_reused")
    assert Run.objects.count() == 4


def test_an_outdated_program_is_refused(participant: Participant) -> None:
    IntakePolicy.objects.create(minimum_app_version="0.10.0")

    assert problem(participant.submit(submission_document(app_version="0.9.9")))[:2] == (426, "app_outdated")
    assert problem(participant.submit(submission_document(app_version="new")))[2] == "app_version"
    assert nothing_is_stored()


def test_a_closed_intake_asks_to_wait(participant: Participant) -> None:
    IntakePolicy.objects.create(accepting=False)

    response = participant.submit(submission_document())

    assert problem(response)[:2] == (503, "not_accepting")
    assert int(response.headers["Retry-After"]) > 0
    assert nothing_is_stored()


def test_too_many_submissions_ask_to_wait(participant: Participant, settings: Any) -> None:
    settings.FRONTRUNNER_SUBMISSIONS_PER_MINUTE = 1
    participant.submit(submission_document())

    response = participant.submit(submission_document())

    assert problem(response)[:2] == (429, "too_many_requests")
    assert int(response.headers["Retry-After"]) > 0
    assert Submission.objects.count() == 1


def test_an_address_or_a_host_that_is_not_served(client: Client) -> None:
    assert problem(client.get(f"{API}/nonsense"))[:2] == (404, "not_found")
    for method in (client.delete, client.options):
        response = method(f"{API}/speedups")
        assert problem(response)[:2] == (405, "method_not_allowed")
        assert response.headers["Allow"] == "GET, HEAD, OPTIONS"
    other = {"Host": "other.example"}
    assert problem(client.get(f"{API}/manifest", headers=other))[:2] == (400, "bad_request")
    assert client.get("/", headers=other).status_code == 400


@pytest.mark.parametrize("cursor", ["%FF", "%C3%A9", "a", "YWJj"])
def test_a_cursor_that_is_none(client: Client, front: Any, cursor: str) -> None:
    assert problem(client.get(f"{API}/speedups?cursor={cursor}")) == (400, "invalid_cursor", "cursor")


def test_what_nobody_foresaw_is_a_problem_under_the_api_and_a_page_elsewhere(rf: RequestFactory) -> None:
    unforeseen = get_resolver().resolve_error_handler(500)

    assert unforeseen(rf.get(f"{API}/speedups")).headers["Content-Type"] == "application/problem+json"
    page = unforeseen(rf.get("/"))
    assert page.status_code == 500
    assert page.headers["Content-Type"].startswith("text/html")
