"""What one request may cost: bytes as sent, bytes after gzip, how much it inflates, how deeply it nests."""

import gzip
import json
import random
from typing import Any

import pytest
from django.test import Client, RequestFactory
from django.test.client import FakePayload
from rest_framework.request import Request

from crowd.http import api
from crowd.http.problems import Problem
from tests.builders.documents import submission_document
from tests.builders.participant import API, Participant
from tests.crowd.refusals import nothing_is_stored, problem

GZIP = {"Content-Encoding": "gzip"}


def read(rf: RequestFactory, body: bytes, **headers: str) -> bytes:
    return api.read_body(Request(rf.post("/", body, content_type="application/json", headers=headers)))


def refusal(rf: RequestFactory, body: bytes, **headers: str) -> Problem:
    with pytest.raises(Problem) as raised:
        read(rf, body, **headers)
    return raised.value


def packed(size: int) -> bytes:
    return gzip.compress(b" " * size, 9)


def test_the_largest_body_is_read_and_one_byte_more_is_not(rf: RequestFactory, settings: Any) -> None:
    settings.FRONTRUNNER_MAX_BODY_BYTES = 1000

    assert read(rf, b"x" * 1000) == b"x" * 1000
    assert refusal(rf, b"x" * 1001).code == "body_too_large"


def test_a_server_that_passes_chunks_on_is_asked_for_a_length(rf: RequestFactory) -> None:
    refused = refusal(rf, b"{}", **{"Transfer-Encoding": "chunked"})

    assert (refused.status, refused.code) == (411, "length_required")


def test_a_body_inflates_to_what_it_might_have_been_plain(rf: RequestFactory, settings: Any) -> None:
    settings.FRONTRUNNER_MAX_BODY_BYTES = 100_000

    assert len(read(rf, packed(100_000), **GZIP)) == 100_000
    assert refusal(rf, packed(100_001), **GZIP).code == "inflated_too_large"


def test_beyond_that_it_inflates_to_a_multiple_of_its_size(rf: RequestFactory, settings: Any) -> None:
    settings.FRONTRUNNER_MAX_BODY_BYTES = 10_000
    settings.FRONTRUNNER_MAX_INFLATED_BYTES = 1_000_000
    # Bytes that gzip cannot make smaller, then blanks that it can.
    noise = random.Random(0).randbytes(5_000)
    little, much = noise + b" " * 400_000, noise + b" " * 900_000
    less, more = (len(body) / len(gzip.compress(body)) for body in (little, much))

    assert less < api.MAX_INFLATION_RATIO < more
    assert read(rf, gzip.compress(little), **GZIP) == little
    assert refusal(rf, gzip.compress(much), **GZIP).code == "inflated_too_large"


def test_nothing_inflates_beyond_the_settings_bytes(rf: RequestFactory, settings: Any) -> None:
    settings.FRONTRUNNER_MAX_INFLATED_BYTES = settings.FRONTRUNNER_MAX_BODY_BYTES = 2_000

    assert refusal(rf, packed(2_001), **GZIP).code == "inflated_too_large"


@pytest.mark.parametrize("opening", ["[", '{"a":'])
def test_json_is_read_to_a_depth_that_no_client_reaches(participant: Participant, opening: str) -> None:
    body = json.dumps(submission_document(deep="DEEP")).replace('"DEEP"', opening * 100_000)

    response = participant.submit(body.encode())

    assert problem(response) == (400, "malformed_json", None)
    assert nothing_is_stored()


def test_a_body_that_breaks_off_is_refused(rf: RequestFactory) -> None:
    class Broken(FakePayload):
        def read(self, *_: Any) -> bytes:
            raise OSError("the connection is gone")

    request = rf.post("/", b"{}", content_type="application/json")
    request.environ["wsgi.input"] = Broken(b"{}")
    request._stream = Broken(b"{}")

    with pytest.raises(Problem) as raised:
        api.read_body(Request(request))
    assert raised.value.code == "body_incomplete"


def test_a_length_that_is_not_a_number_is_refused(client: Client, db: None) -> None:
    response = client.generic(
        "POST", f"{API}/enrol", b"{}", content_type="application/json", CONTENT_LENGTH="many"
    )

    assert (response.status_code, response.json()["code"]) == (411, "length_required")


def test_a_number_of_rows_beyond_reason(client: Client, db: None) -> None:
    digits = "9" * 5_000

    assert client.get(f"{API}/devices?limit={digits}").json()["code"] == "invalid_limit"
    assert client.get(f"{API}/speedups?min_sessions={digits}").json()["code"] == "invalid_filter"


@pytest.mark.parametrize("path", ["/fronts/a%00b", "/speedups?soc=%00", "/manifest?application=%00"])
def test_a_nul_in_an_address(client: Client, db: None, path: str) -> None:
    response = client.get(f"{API}{path}")

    assert (response.status_code, response.json()["code"]) == (400, "null_character")


def test_a_nul_in_the_address_of_a_page(client: Client) -> None:
    """Without a database: nothing is asked of it."""
    addresses = (
        "/?gpu=%00", "/fronts/%00/", "/devices/?soc=a%00", "/transfer/?os=%00", "/card.png?gpu=%00",
        "/tables/fronts/%00.csv", "/tables/speedups.json?gpu=%00", "/embed/speedups/?gpu=%00",
        "/compare/?device=%00&configurations=a,b", "/static/%00", "/admin/?q=%00",
    )  # fmt: skip

    answers = {address: client.get(address) for address in addresses}

    told = {a: (r.status_code, r["Content-Type"], "NUL" in r.content.decode()) for a, r in answers.items()}
    assert told == dict.fromkeys(addresses, (400, "text/plain; charset=utf-8", True))


def test_an_unknown_address_is_not_found_without_cookies(db: None) -> None:
    response = Client(enforce_csrf_checks=True).post(f"{API}/nonsense", {})

    assert (response.status_code, response.json()["code"]) == (404, "not_found")
