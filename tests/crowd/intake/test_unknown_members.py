"""A newer client may send more than this server knows: it is kept, within bounds, and never misunderstood."""

import json
from typing import Any

import pytest

from crowd.results.models import MeasurementSession, Run, Submission
from tests.builders.documents import device_document, session_document, submission_document
from tests.builders.participant import Participant
from tests.crowd.refusals import nothing_is_stored, problem

DEVICE = "/devices/google-pixel-8"


def newer() -> dict[str, Any]:
    """A submission with members of another year in each of its parts."""
    session = session_document(governor="schedutil", frame_ids=[1, 2, {"of": None}])
    session["samples"][0]["fan_rpm"] = 1200
    session["samples"].append({"t": 1.0})
    session["runs"][1]["energy_joules"] = 3.5
    return submission_document(session, device=device_document(screen_hz=120), campaign="winter")


def test_unknown_members_are_kept_as_they_came(participant: Participant) -> None:
    response = participant.submit(newer())

    assert {item["status"] for item in response.json()["items"]} == {"accepted"}
    session = MeasurementSession.objects.get()
    assert Submission.objects.get().extra == {"campaign": "winter"}
    assert session.extra == {"governor": "schedutil", "frame_ids": [1, 2, {"of": None}]}
    assert session.samples == [
        {"t": 0.0, "temperature_c": 41.5, "cpu_mhz": 2400.0, "battery": None, "fan_rpm": 1200},
        {"t": 1.0},
    ]
    assert session.description.raw["screen_hz"] == 120
    assert list(Run.objects.order_by("order").values_list("extra", flat=True)) == [
        {}, {"energy_joules": 3.5}, {}, {},
    ]  # fmt: skip


def test_they_come_back_with_ones_own_data_and_are_nowhere_in_public(participant: Participant) -> None:
    participant.submit(newer())

    data = json.dumps(participant.own_data())
    public = [participant.get(path).content.decode() for path in ("/speedups", "/devices", DEVICE)]

    for name in ("campaign", "governor", "fan_rpm", "energy_joules", "screen_hz"):
        assert name in data
    assert not [text for text in public if "winter" in text or "schedutil" in text]


@pytest.mark.parametrize(
    ("part", "members", "code"),
    [
        ("", {"user_name": "x"}, "personal_data"),
        ("", {"notes": "x" * 5_000}, "extra_too_large"),
        ("", {"tree": [[[[[[[[[[1]]]]]]]]]]}, "extra_too_deep"),
        ("sessions[0].", {"location": [1, 2]}, "personal_data"),
        ("sessions[0].", {"log": "x" * 20_000}, "extra_too_large"),
    ],
)
def test_what_is_not_kept_is_refused(
    participant: Participant, part: str, members: dict[str, Any], code: str
) -> None:
    document = submission_document()
    (document["sessions"][0] if part else document).update(members)

    response = participant.submit(document)

    assert problem(response) == (400, code, f"{part}{next(iter(members))}")
    assert nothing_is_stored()


def test_samples_are_bound_together(participant: Participant) -> None:
    samples = [{"t": float(second), "log": "x" * 100} for second in range(200)]

    response = participant.submit(submission_document(session_document(samples=samples)))

    assert problem(response)[1:] == ("extra_too_large", "sessions[0].samples")


def test_a_person_in_one_run_costs_only_that_run(participant: Participant) -> None:
    session = session_document()
    session["runs"][2]["owner"] = "x"
    session["runs"][3]["trace"] = "x" * 5_000

    items = participant.submit(submission_document(session)).json()["items"]

    assert [item["code"] for item in items] == [None, None, "personal_data", "extra_too_large"]
    assert items[2]["field"] == "sessions[0].runs[2].owner"
    assert Run.objects.count() == 2


def test_fifty_runs_with_a_member_more_are_taken(participant: Participant) -> None:
    sessions = [session_document() for _ in range(13)]
    sessions[-1]["runs"] = sessions[-1]["runs"][:2]
    runs = [run for session in sessions for run in session["runs"]]
    for number, run in enumerate(runs):
        run |= {"stages_us": {}, "note": number}

    response = participant.submit(submission_document(*sessions))

    assert response.status_code == 202
    assert sorted(extra["note"] for extra in Run.objects.values_list("extra", flat=True)) == list(range(50))
