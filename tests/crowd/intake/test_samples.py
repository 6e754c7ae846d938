"""Samples of the device's state: at most one a second, and none after the session's end."""

import json
from typing import Any

from crowd.results.intake import checks
from crowd.results.models import MeasurementSession
from tests.builders.documents import run_document, session_document, submission_document
from tests.builders.participant import Participant
from tests.crowd.refusals import nothing_is_stored, problem


def sampled(*times: float) -> dict[str, Any]:
    return session_document(samples=[{"t": t} for t in times])


def test_one_sample_a_second_is_taken_however_it_is_rounded(participant: Participant) -> None:
    times = [0.0, *(second + 0.004 for second in range(1, 300)), 299.9]

    assert participant.submit(submission_document(sampled(*reversed(times)))).status_code == 202
    assert len(MeasurementSession.objects.get().samples) == 301


def test_a_sample_after_the_sessions_end_is_refused(participant: Participant) -> None:
    """Four runs, of 18 s together."""
    longest = checks.LOADING_SECONDS + 4 * checks.RUN_SECONDS + checks.DURATION_FACTOR * 18

    late = participant.submit(submission_document(sampled(0.0, longest + 1)))

    assert problem(late) == (422, "too_many_samples", "sessions[0].samples")
    assert participant.submit(submission_document(sampled(0.0, longest - 1))).status_code == 202


def test_a_session_with_bad_samples_does_not_cost_the_others(participant: Participant) -> None:
    bad, good = sampled(*[1.0] * 10), session_document()

    items = participant.submit(submission_document(bad, good)).json()["items"]

    assert [item["code"] for item in items] == ["too_many_samples"] * 4 + [None] * 4
    assert str(MeasurementSession.objects.get().uuid) == good["id"]


def test_the_storm_of_samples_is_not_stored(participant: Participant) -> None:
    """Such sessions cost few bytes to send, and many in the database and in the open data."""

    def run() -> list[dict[str, Any]]:
        return [run_document("best", 0, 0, 1_000, stages_us={}, tracked=None)]

    sessions = [session_document(samples=[{"t": 3}] * 500, runs=run()) for _ in range(50)]

    response = participant.submit_gzipped(json.dumps(submission_document(*sessions)).encode())

    assert problem(response)[:2] == (422, "too_many_samples")
    assert nothing_is_stored()


def test_samples_are_kept_as_they_came(participant: Participant) -> None:
    samples = [{"t": 0.0, "battery": None}, {"t": 1.0, "cpu_mhz": 1800.0}]

    participant.submit(submission_document(session_document(samples=samples)))

    assert MeasurementSession.objects.get().samples == samples
