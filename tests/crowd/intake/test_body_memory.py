"""No body below the size limits costs more than 20 MB of memory, whatever it holds."""

import gzip
import json
import random
import tracemalloc
from collections.abc import Callable
from typing import Any

import pytest
from django.conf import settings

from crowd.fronts.publishing.services import publish_content
from crowd.http import json_limits
from crowd.results.intake import checks
from crowd.results.models import Submission
from tests.builders.documents import front_document, run_document, session_document, submission_document
from tests.builders.participant import Participant
from wire.protocol import MOST_RUNS

MOST = 20_000_000
VALUES = json_limits.MAX_VALUES
INFLATED = settings.FRONTRUNNER_MAX_INFLATED_BYTES
# A text with one character beyond the basic plane takes four bytes a character in memory.
NOISE = bytes(random.Random(0).choices(b" \t\n\r", k=400_000))
WIDE = "\\ud83d\\ude00"


# Where content is put into a submission; "" stands for the submission, "device" and so on for its parts.
PARTS = {
    "device": ("device", "parts"),
    "submission": ("", "extra"),
    "app_version": ("", "app_version"),
    "sessions": ("", "sessions"),
    "session": ("session", "extra"),
    "samples": ("session", "samples"),
    "runs": ("session", "runs"),
    "sample": ("sample", "extra"),
    "run": ("run", "extra"),
    "id": ("run", "id"),
    "times": ("run", "frame_us"),
    "stages": ("run", "stages_us"),
}


def within(part: str, content: str) -> bytes:
    """A submission with `content` (JSON) in one of PARTS, or `content` alone as the whole body."""
    if part == "body":
        return content.encode()
    session = session_document()
    document = submission_document(session)
    places = {"": document, "device": document["device"], "session": session}
    places |= {"sample": session["samples"][0], "run": session["runs"][0]}
    place, member = PARTS[part]
    places[place][member] = "CONTENT"
    return json.dumps(document).replace('"CONTENT"', content, 1).encode()


def of(piece: str, count: int, opening: str = "[", closing: str = "]") -> str:
    return opening + ",".join([piece] * count) + closing


def named(count: int, value: str) -> str:
    """An object whose `count` members have different names."""
    return "{" + ",".join(f'"{number:x}":{value}' for number in range(count)) + "}"


def padded(body: bytes) -> bytes:
    """`body` with blanks behind it, as large as a body may be. Random ones keep its gzip large enough."""
    return (body + NOISE).ljust(INFLATED)


def peak(act: Callable[[], Any]) -> tuple[int, Any]:
    tracemalloc.start()
    try:
        answer = act()
        return tracemalloc.get_traced_memory()[1], answer
    finally:
        tracemalloc.stop()


# What passes the scan, each as large as it lets it be. An ordinary submission has less than 3,500 values.
ROOM = VALUES - 3_500
TAKEN = {
    "empty lists": of("[]", ROOM // 2),
    "small objects": of('{"a":1}', ROOM // 3),
    "members": named(ROOM // 2, "1"),
    "members with lists": named(ROOM // 3, "[]"),
    "numbers": of("4294967295", ROOM),
    "a huge number": "9" * 3_000_000,
    "escapes": '"' + "\\n" * 30_000 + '"',
    "wide texts": of('"' + WIDE + "x" * 60_000 + '"', 40),
    "samples": of('{"t":1}', ROOM // 3),
}
REFUSED = {
    "too many empty lists": of("[]", 1_000_000),
    "too many small objects": of('{"a":1}', 400_000),
    "too many members": named(200_000, "1"),
    "deep lists": "[" * 100_000 + "]" * 100_000,
    "deep objects": '{"a":' * 100_000 + "1" + "}" * 100_000,
    "a long text of escapes": '"' + "\\u00e9" * 500_000 + '"',
    "a long wide text": '"' + WIDE + "x" * 3_000_000 + '"',
}


def cost(participant: Participant, body: bytes, path: str = "/submissions:validate") -> tuple[int, Any]:
    """The most memory that `body` takes, in bytes, with what is read and inflated; and the answer."""
    content = gzip.compress(padded(body), 1)
    assert len(content) < settings.FRONTRUNNER_MAX_BODY_BYTES
    return peak(lambda: participant.submit(content, path=path, **{"Content-Encoding": "gzip"}))


@pytest.fixture
def known(participant: Participant, settings: Any) -> Participant:
    """One whose first requests filled what a process keeps, and who may send as much as it likes."""
    settings.FRONTRUNNER_BYTES_PER_DAY = settings.FRONTRUNNER_VALUES_PER_DAY = 0
    participant.submit(submission_document(), path="/submissions:validate")
    return participant


def each_part_and_shape() -> list[Any]:
    """All shapes in all parts. Those beyond two shapes a part, each of them in two parts, are exhaustive."""
    return [
        pytest.param(
            part,
            shape,
            id=f"{shape} in {part}",
            marks=[] if (number - place) % len(TAKEN) in {0, 4} else [pytest.mark.exhaustive],
        )
        for place, part in enumerate(["body", *PARTS])
        for number, shape in enumerate(TAKEN)
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("part", "shape"), each_part_and_shape())
def test_what_is_decoded_costs_little(known: Participant, part: str, shape: str) -> None:
    most, answer = cost(known, within(part, TAKEN[shape]))

    assert answer.status_code in {200, 400, 422}, answer.content
    assert "too_many_values" not in answer.content.decode()
    assert most < MOST


@pytest.mark.slow
@pytest.mark.parametrize("shape", REFUSED)
def test_what_is_too_much_is_refused_before_it_is_decoded(known: Participant, shape: str) -> None:
    most, answer = cost(known, within("run", REFUSED[shape]))

    assert answer.status_code == 400
    assert answer.json()["code"] in {"too_many_values", "text_too_long", "malformed_json"}
    assert most < MOST


@pytest.mark.parametrize("shape", ["too many empty lists", "deep objects", "a long wide text"])
def test_an_enrolment_costs_little(known: Participant, shape: str) -> None:
    most, answer = cost(known, REFUSED[shape].encode(), "/enrol")

    assert answer.status_code == 400
    assert most < MOST


def test_the_largest_submission_of_a_client_is_taken(participant: Participant, pack: dict[str, Any]) -> None:
    stages = {f"stage_{number}": [4_000] * 100 for number in range(checks.MAX_STAGES)}
    reading = {"temperature_c": 41.5, "cpu_mhz": 2400.0, "battery": 55.0}
    document = front_document(pack, "long", pairs=MOST_RUNS // 2)
    document["protocol"]["order"] = ["default", "best"]
    front = publish_content(document)[0]
    session = session_document(
        front.slug,
        runs=[
            run_document(name, number // 2, number, 80_000, stages_us=stages)
            for number, name in enumerate(["default", "best"] * (MOST_RUNS // 2))
        ],
        samples=[{"t": 1.004 * second, **reading} for second in range(2_000)],
    )

    response = participant.submit_gzipped(json.dumps(submission_document(session)).encode())

    assert response.status_code == 202, response.content
    assert {item["status"] for item in response.json()["items"]} == {"accepted"}
    assert Submission.objects.count() == 1
