"""What one installation, and one address, may send in a day, counted before anything is decoded or stored."""

import json
import sqlite3
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from django.db import connection

from crowd.fronts.models import FrontVersion
from crowd.results.intake import daily_limits
from crowd.results.models import Run, Submission
from tests.builders.crowds import Join
from tests.builders.documents import device_document, run_document, session_document, submission_document
from tests.builders.participant import Participant
from tests.crowd.refusals import problem

BODY = json.dumps(submission_document()).encode()
DAILY = {
    "FRONTRUNNER_BYTES_PER_DAY": "bytes",
    "FRONTRUNNER_VALUES_PER_DAY": "values",
    "FRONTRUNNER_STORED_BYTES_PER_DAY": "stored",
}


def document() -> bytes:
    return json.dumps(submission_document()).encode()


def is_limited(response: Any) -> bool:
    return response.status_code == 429 and problem(response)[1] == "daily_limit"


def counted(folder: Path, name: str) -> int:
    """What was counted under `name`, of the installation that sent first."""
    rows = sqlite3.connect(folder / "counters.sqlite3").execute(
        "SELECT used FROM counts WHERE key LIKE ?", (f"daily-{name}:installation:%",)
    )
    return int(rows.fetchone()[0])


@pytest.mark.slow
@pytest.mark.parametrize(("setting", "name"), DAILY.items())
def test_an_installation_has_an_allowance_for_a_day(
    participant: Participant, join: Join, settings: Any, own_data_folder: Path,
    setting: str, name: str,
) -> None:  # fmt: skip
    first = participant.submit_gzipped(document())
    setattr(settings, setting, int(2.5 * counted(own_data_folder, name)))

    second, third = (participant.submit_gzipped(document()) for _ in range(2))

    assert [first.status_code, second.status_code, third.status_code] == [202, 202, 429]
    assert is_limited(third)
    assert 0 < int(third.headers["Retry-After"]) <= 24 * 3600
    assert Submission.objects.count() == 2
    assert join().submit(document()).status_code == 202


@pytest.mark.slow
def test_what_an_address_stores_is_shared_in_equal_parts(
    front: FrontVersion, join: Join, settings: Any, own_data_folder: Path
) -> None:
    greedy = [join() for _ in range(daily_limits.ADDRESS_FACTOR)]
    greedy[0].submit(document())
    one = counted(own_data_folder, "stored")
    settings.FRONTRUNNER_STORED_BYTES_PER_DAY = int(2.5 * one)
    for participant in greedy:  # each sends what it may: together more than the address may
        while participant.submit(document()).status_code == 202:
            pass

    newcomer = join()

    assert newcomer.submit(document()).status_code == 202
    answers = [newcomer.submit(document()) for _ in range(3)]
    assert is_limited(answers[-1])


def test_refused_bodies_of_one_leave_others_behind_the_address_alone(
    front: FrontVersion, join: Join, settings: Any
) -> None:
    settings.FRONTRUNNER_BYTES_PER_DAY = settings.FRONTRUNNER_VALUES_PER_DAY = 100_000
    for _ in range(2 * daily_limits.ADDRESS_FACTOR):
        assert problem(join().submit(b"[" * 95_000))[1] == "malformed_json"

    assert join().submit(document()).status_code == 202


def test_what_cannot_be_read_counts_too_and_is_not_read_beyond_the_limit(
    participant: Participant, settings: Any
) -> None:
    settings.FRONTRUNNER_BYTES_PER_DAY = 1_000

    first, second = (participant.submit(b"[" * 600) for _ in range(2))

    assert problem(first)[1] == "malformed_json"
    assert is_limited(second)


def test_a_dry_run_counts_what_it_reads_and_not_what_it_would_store(
    participant: Participant, settings: Any
) -> None:
    settings.FRONTRUNNER_STORED_BYTES_PER_DAY = 1
    settings.FRONTRUNNER_BYTES_PER_DAY = int(2.5 * len(BODY))

    answers = [participant.submit(document(), path="/submissions:validate") for _ in range(3)]

    assert [answer.status_code for answer in answers] == [200, 200, 429]


def test_a_replay_is_answered_as_before_beyond_the_limit(participant: Participant, settings: Any) -> None:
    settings.FRONTRUNNER_BYTES_PER_DAY = int(1.5 * len(BODY))
    body = document()
    first = participant.submit(body, key="a")
    assert is_limited(participant.submit(document()))

    again = participant.submit(body, key="a")

    assert (again.status_code, again.content) == (200, first.content)


def test_the_next_day_it_goes_on(
    participant: Participant, settings: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings.FRONTRUNNER_BYTES_PER_DAY = int(1.5 * len(BODY))
    body, now = document(), 1_000_000.0
    monkeypatch.setattr("crowd.access.counters.time.time", lambda: now)
    participant.submit(document())
    refused = participant.submit(body, key="a")

    now += int(refused.headers["Retry-After"])

    assert participant.submit(body, key="a").status_code == 202


@pytest.mark.slow
@pytest.mark.parametrize("setting", DAILY)
def test_a_limit_of_0_is_not_a_limit(participant: Participant, settings: Any, setting: str) -> None:
    setattr(settings, setting, 0)

    assert [participant.submit(document()).status_code for _ in range(3)] == [202] * 3


def test_what_cannot_be_counted_is_let_through(
    participant: Participant, settings: Any, caplog: pytest.LogCaptureFixture
) -> None:
    settings.FRONTRUNNER_CACHE_URL = "redis://127.0.0.1:1/0"

    assert participant.submit(document()).status_code == 202
    assert "not counted" in caplog.text


def database_bytes() -> int:
    with connection.cursor() as cursor:
        cursor.execute(
            "SELECT (page_count - freelist_count) * page_size "
            "FROM pragma_page_count, pragma_freelist_count, pragma_page_size"
        )
        return int(cursor.fetchone()[0])


def failed(configuration: str) -> dict[str, Any]:
    """A run of as few bytes as possible."""
    run = {"id": str(uuid.uuid4()), "configuration": configuration, "repeat": 0, "order": 0}
    return run | {"status": "failed", "frame_us": []}


def many_rows(_: int) -> dict[str, Any]:
    """As many rows, and as much copied from the device into each, as so many bytes allow."""
    sessions = [session_document(samples=[], runs=[failed("default"), failed("best")]) for _ in range(12)]
    return submission_document(*sessions, device=device_document(opencl_device="😀" * 200))


def whole_front(_: int) -> dict[str, Any]:
    stages = {f"stage_{number}": [4_000_000] * 100 for number in range(8)}
    runs = [run_document("best", number, number, 80_000, stages_us=stages) for number in range(50)]
    samples = [{"t": float(second), "temperature_c": 40.0} for second in range(400)]
    return submission_document(session_document(runs=runs, samples=samples))


def long_texts(_: int) -> dict[str, Any]:
    """Characters that the database's JSON writes with three times as many bytes."""
    runs = [run_document("best", n, n, 1_000, note="é" * 1_900, failure="é" * 500) for n in range(50)]
    return submission_document(session_document(runs=runs, note="é" * 7_500), note="é" * 1_900)


def many_chips(number: int) -> dict[str, Any]:
    """A description, and figures, of its own for each request of few runs."""
    runs = [run_document("default", 0, 0, 900), run_document("best", 0, 1, 90)]
    device = device_document(opencl_device=f"chip {number}", note="é" * 5_000)
    return submission_document(session_document(samples=[], runs=runs), device=device)


@pytest.mark.slow
@pytest.mark.parametrize("content", [many_rows, whole_front, long_texts, many_chips])
def test_the_database_grows_by_no_more_than_was_counted(
    participant: Participant,
    settings: Any,
    own_data_folder: Path,
    content: Callable[[int], dict[str, Any]],
) -> None:
    if connection.vendor != "sqlite":
        pytest.skip("pages are counted in SQLite")
    settings.FRONTRUNNER_STORED_BYTES_PER_DAY = 1 << 30

    def submit(number: int) -> None:
        answer = participant.submit(json.dumps(content(number), ensure_ascii=False).encode())
        assert answer.status_code == 202, answer.content

    for number in range(2):  # every table and index has its first pages
        submit(number)
    before = database_bytes(), counted(own_data_folder, "stored")

    for number in range(2, 6):
        submit(number)

    grown = database_bytes() - before[0]
    assert Run.objects.count() >= 12
    assert 0 < grown <= counted(own_data_folder, "stored") - before[1]
