"""Sessions by the protocol: what they need, what counts, and where it is shown."""

import json
import re
from typing import Any

import numpy as np
import pytest
from django.test import Client

from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing.services import publish_content
from crowd.results.models import MeasurementSession, Run, SessionSummary
from crowd.results.opendata import exports
from tests.builders.crowds import Join
from tests.builders.documents import (
    BAND,
    DEVIATION,
    EMPTY_FRAME_US,
    front_document,
    session_document,
    submission_document,
)
from tests.builders.participant import API, Participant
from tests.crowd.exported import table
from tests.crowd.refusals import problem


@pytest.fixture
def front(db: None, pack: dict[str, Any]) -> FrontVersion:
    """A published front whose sessions have four pairs."""
    return publish_content(front_document(pack, pairs=4))[0]


def session(**changes: Any) -> dict[str, Any]:
    return session_document(pairs=4, **changes)


def submit(participant: Participant, sent: dict[str, Any]) -> Any:
    return participant.submit(submission_document(sent))


def codes(response: Any) -> list[str | None]:
    return [item["code"] for item in response.json()["items"]]


def test_a_session_counts_with_a_plain_interval_over_its_pairs(participant: Participant) -> None:
    sent = session()
    for run, frame_us in zip(sent["runs"], [80, 10, 11, 80, 80, 10, 11, 80], strict=True):
        run |= {"frame_us": [frame_us * 1000] * 100, "stages_us": None}
    logs = np.log([8, 80 / 11, 8, 80 / 11])
    half = 3.182 * logs.std(ddof=1) / 2  # Student's t with 3 degrees of freedom

    assert submit(participant, sent).status_code == 202

    summary = SessionSummary.objects.get()
    assert (summary.state, summary.reason, summary.pairs) == ("valid", "", 4)
    assert (summary.low, summary.high) == pytest.approx((logs.mean() - half, logs.mean() + half))


def test_two_pairs_of_four_are_incomplete(participant: Participant) -> None:
    sent = session()
    sent["runs"] = sent["runs"][:4]

    submit(participant, sent)

    assert SessionSummary.objects.get().reason == "incomplete_pairs"


def test_how_times_were_taken_and_deviations_are_stored(participant: Participant) -> None:
    submit(participant, session())

    stored = MeasurementSession.objects.get()
    assert (stored.empty_frame_us, stored.stage_clock, stored.extra) == (EMPTY_FRAME_US, "wall", {})
    assert {run.deviation for run in stored.runs.all()} == {DEVIATION}
    assert {json.dumps(run.extra) for run in stored.runs.all()} == {"{}"}


@pytest.mark.parametrize("value", [0, 212.5, 60_000_000])
def test_the_whole_range_of_an_empty_frame_is_taken(participant: Participant, value: float) -> None:
    assert submit(participant, session(empty_frame_us=value)).status_code == 202
    assert MeasurementSession.objects.get().empty_frame_us == value


@pytest.mark.slow
@pytest.mark.parametrize(
    ("member", "value", "code"),
    [
        ("deviation", None, "deviation_missing"),
        ("deviation", -0.001, "negative_error"),
        ("deviation", "near", "invalid_field"),
        ("deviation", True, "invalid_field"),
        ("deviation", 10**400, "not_finite"),
        ("repeat", 4, "too_many_repeats"),
    ],
)
def test_a_run_with_a_wrong_member_costs_only_itself(
    participant: Participant, member: str, value: Any, code: str
) -> None:
    sent = session()
    sent["runs"][1][member] = value

    items = submit(participant, sent).json()["items"]

    assert [item["code"] for item in items] == [None, code, *[None] * 6]
    assert items[1]["field"] == f"sessions[0].runs[1].{member}"
    assert Run.objects.count() == 7


def test_a_failed_run_needs_no_deviation(participant: Participant) -> None:
    sent = session()
    sent["runs"][1] |= {"status": "failed", "frame_us": [], "stages_us": {}, "tracked": [], "deviation": None}

    assert codes(submit(participant, sent)) == [None] * 8
    assert Run.objects.get(status="failed").deviation is None


def test_without_a_clock_there_are_no_stages(participant: Participant) -> None:
    sent = session(stage_clock="none")
    for run in sent["runs"][1:]:
        run["stages_us"] = None

    items = submit(participant, sent).json()["items"]

    assert [item["code"] for item in items] == ["stages_without_clock", *[None] * 7]
    assert items[0]["field"] == "sessions[0].runs[0].stages_us"


@pytest.mark.parametrize("stages", [None, {}])
def test_a_session_without_stages_counts_and_is_shown(
    client: Client, participant: Participant, stages: Any
) -> None:
    sent = session(stage_clock="none")
    for run in sent["runs"]:
        run["stages_us"] = stages
        run["frame_us"] = np.random.default_rng(run["order"]).integers(10_000, 10_100, 100).tolist()

    submit(participant, sent)

    assert SessionSummary.objects.get().state == "valid"
    page = client.get(f"/sessions/{sent['id']}/").content.decode()
    assert "no stages timed" in page
    assert client.get(f"/runs/{sent['runs'][0]['id']}/").status_code == 200


def test_identical_series_are_found_without_stages(participant: Participant, join: Join) -> None:
    times = np.random.default_rng(0).integers(10_000, 10_100, 100).tolist()
    for sender in (participant, join()):
        sent = session(stage_clock="none")
        for run in sent["runs"]:
            run |= {"frame_us": times, "stages_us": None}
        submit(sender, sent)

    assert [row.reason for row in SessionSummary.objects.order_by("pk")] == ["", "identical_series"]


def test_a_run_outside_its_band_does_not_count(participant: Participant) -> None:
    sent = session()
    for run, deviation in zip(sent["runs"], [BAND, 1.01 * BAND] * 4, strict=True):
        run["deviation"] = deviation

    submit(participant, sent)

    assert [(run.state, run.reason) for run in Run.objects.order_by("order")] == [
        ("valid", ""),
        ("invalid", "deviation_above_band"),
    ] * 4


def test_each_configuration_has_its_own_band(participant: Participant, pack: dict[str, Any]) -> None:
    document = front_document(pack, "2", pairs=4)
    document["configurations"][1]["band"] = 10 * BAND
    publish_content(document)
    sent = session(front="kfusion-2")
    for run in sent["runs"]:
        run["deviation"] = 2 * BAND

    submit(participant, sent)

    states = set(Run.objects.values_list("configuration__name", "state"))
    assert states == {("default", "invalid"), ("best", "valid")}
    assert SessionSummary.objects.get().reason == "deviation_above_band"


@pytest.mark.parametrize("version", [0, 1, 3])
def test_a_session_of_another_protocol_is_refused(participant: Participant, version: int) -> None:
    sent = session(protocol_version=version)
    del sent["empty_frame_us"], sent["stage_clock"]

    response = submit(participant, sent)

    assert problem(response) == (422, "unknown_protocol_version", "sessions[0].protocol_version")
    assert "this server takes sessions of protocol 2" in response.json()["detail"]


def test_pages_api_open_data_and_own_data_show_the_members(client: Client, participant: Participant) -> None:
    sent = session()
    submission = submit(participant, sent).json()["submission_id"]
    exports.create_export()

    [shown] = participant.get(f"/submissions/{submission}").json()["sessions"]
    assert (shown["empty_frame_us"], shown["stage_clock"]) == (EMPTY_FRAME_US, "wall")
    [own] = participant.own_data()["sessions"]
    assert (own["empty_frame_us"], own["stage_clock"]) == (EMPTY_FRAME_US, "wall")
    assert {run["deviation"] for run in own["runs"]} == {DEVIATION}
    [row] = table("sessions")
    assert (row["empty_frame_us"], row["stage_clock"]) == (EMPTY_FRAME_US, "wall")
    assert {row["deviation"] for row in table("runs")} == {DEVIATION}
    assert {row["band"] for row in table("configurations")} == {BAND}
    page = client.get(f"/sessions/{sent['id']}/").content.decode()
    assert "Empty frame</dt><dd>0.250" in page
    assert "Deviation</th>" in page
    run = client.get(f"/runs/{sent['runs'][0]['id']}/").content.decode()
    assert re.search(r"0\.05\s*cm from the reference trajectory", run)


def test_the_api_document_describes_the_members(client: Client) -> None:
    schemas = client.get(f"{API}/openapi.json").json()["components"]["schemas"]

    assert "'device', 'none', 'wall'" in str(schemas["Session"]["properties"]["stage_clock"])
    assert "an empty frame" in str(schemas["Session"]["properties"]["empty_frame_us"])
    assert "deviation" in schemas["Run"]["properties"]
    assert {"empty_frame_us", "stage_clock"}.isdisjoint(schemas["Session"]["required"])
    assert {"band", "trajectory"}.isdisjoint(schemas["Configuration"]["required"])
