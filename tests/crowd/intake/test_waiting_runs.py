"""Between its intake and its task a run is pending: stored, shown as waiting, and part of no figure."""

import pytest
from django.test import Client

from crowd.results.figures import sessions as session_figures
from crowd.results.models import DeviceSpeedup, Run
from tests.builders.documents import submission_document
from tests.builders.participant import Participant


def test_a_new_run_waits_to_be_judged_by_the_task(participant: Participant, no_worker: None) -> None:
    participant.submit(submission_document())
    waiting = set(Run.objects.values_list("state", "reason", "mean_us", "fingerprint"))
    assert not DeviceSpeedup.objects.exists()

    session_figures.summarise_waiting()

    assert waiting == {("pending", "", None, None)}
    assert set(Run.objects.values_list("state", "mean_us")) == {("valid", 80_000.0), ("valid", 10_000.0)}
    assert DeviceSpeedup.objects.get().speedup == pytest.approx(8.0)


def test_pages_and_api_say_that_it_waits(participant: Participant, no_worker: None, client: Client) -> None:
    key = participant.submit(submission_document()).json()["submission_id"]
    run = Run.objects.select_related("session").order_by("order")[0]

    page = client.get(f"/runs/{run.uuid}/").content.decode()
    session = client.get(f"/sessions/{run.session.uuid}/").content.decode()

    assert '<span class="state state-pending">waiting</span>' in page
    assert "look again in a minute" in page
    assert "waiting</span>" in session
    assert "pending</span>" not in page + session
    assert participant.get(f"/submissions/{key}").json()["summarised"] is False
    runs = participant.own_data()["sessions"][0]["runs"]
    assert {run["state"] for run in runs} == {"pending"}
