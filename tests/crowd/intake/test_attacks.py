"""What one client tries against figures, pages and the administration, and what does not come of it."""

import json
from typing import Any

import pytest
from django.contrib.auth.models import User
from django.test import Client
from django.urls import reverse

from crowd.devices import revision
from crowd.devices.models import DeviceDescription, DeviceModel, Installation, Revision
from crowd.results import tasks
from crowd.results.models import DeviceSpeedup, SessionSummary, StoredFile
from crowd.results.opendata import exports
from tests.builders.crowds import Join, crowd, send
from tests.builders.documents import device_document, session_document, submission_document
from tests.builders.participant import Participant

SCRIPT = "<script>alert(1)</script>"


@pytest.mark.slow
def test_sessions_dated_over_many_years_count_as_one_day_s(participant: Participant) -> None:
    for year in range(2019, 2026):
        send(participant, session_document(started_at=f"{year}-07-01T12:00:00Z"))

    assert SessionSummary.objects.filter(counted=True).count() == 5
    figure = DeviceSpeedup.objects.get()
    assert (figure.sessions, figure.units) == (5, 1)


@pytest.mark.slow
def test_one_installation_with_many_chips_is_one_model(participant: Participant) -> None:
    for number in range(1, 9):
        device = device_document(soc_model=f"SM8{number:03}", opencl_device=f"Invented {number}")
        send(participant, device=device)

    assert DeviceModel.objects.count() == 1
    # No rule knows the chips: they are one.
    assert set(DeviceSpeedup.objects.values_list("processor")) == {("unknown chip",)}


def test_a_description_that_is_refused_leaves_nothing(participant: Participant) -> None:
    send(participant)
    refused = participant.submit(submission_document(session_document(), device=device_document("Pixel 9")))

    assert refused.status_code == 409
    assert (DeviceModel.objects.count(), DeviceDescription.objects.count()) == (1, 1)


@pytest.mark.slow
def test_erasing_and_sending_again_leaves_no_rows_of_devices(join: Join, front: Any) -> None:
    for number in range(5):
        participant = join()
        send(participant, device=device_document(f"Invented {number}", note="x" * 1_000))
        assert participant.delete("/me").status_code == 204

    assert not any(kept.objects.exists() for kept in (DeviceModel, DeviceDescription, DeviceSpeedup))


def test_revisions_do_not_pile_up_and_each_change_is_a_new_one(participant: Participant) -> None:
    seen = set()
    for _ in range(3 * revision.KEPT_ROWS):
        revision.bump()
        seen.add(revision.current())

    tasks.sweep()

    assert len(seen) == 3 * revision.KEPT_ROWS
    assert Revision.objects.count() <= revision.KEPT_ROWS
    assert revision.current() not in seen


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [
        "devices_devicemodel", "devices_devicedescription", "devices_installation",
        "results_measurementsession", "results_run", "results_submission",
    ],
)  # fmt: skip
def test_the_administration_shows_raw_text_as_text(participant: Participant, db: None, page: str) -> None:
    device = device_document(SCRIPT, manufacturer=SCRIPT, cpu=SCRIPT, soc_model=SCRIPT)
    session = session_document(extra={"note": SCRIPT}, note=SCRIPT)
    session["runs"][0] |= {"status": "failed", "failure": SCRIPT, "note": SCRIPT}
    participant.submit(submission_document(session, device=device, note=SCRIPT), key=SCRIPT.replace(" ", ""))
    Installation.objects.update(app=SCRIPT)
    staff = Client()
    staff.force_login(User.objects.create_superuser("root"))

    listed = staff.get(reverse(f"admin:{page}_changelist"))
    rows = listed.context["cl"].result_list
    shown = staff.get(reverse(f"admin:{page}_change", args=[rows[0].pk]))

    assert (listed.status_code, shown.status_code) == (200, 200)
    assert SCRIPT not in listed.content.decode() + shown.content.decode()


@pytest.mark.slow
def test_the_true_name_of_a_masked_model_finds_nothing(
    client: Client, join: Join, front: Any, settings: Any
) -> None:
    settings.FRONTRUNNER_RARE_BELOW = 5
    crowd(join, {"Pixel 8": 8.0, "Pixel 9": 8.0})
    slugs = [row["slug"] for row in client.get("/api/v1/devices").json()["results"]]

    texts = [
        client.get(f"/api/v1/speedups?{query}").content.decode()
        for query in ("device=pixel", "device=google+8", 'soc="pixel"', "gpu=pixel", "os=pixel")
    ]
    addresses = [
        "/devices/google-pixel-8/",
        "/devices/google-pixel-8/card.png",
        "/api/v1/devices/google-pixel-8",
        f"/api/v1/compare?devices=google-pixel-8,{slugs[0]}",
        "/tables/devices/google-pixel-8/configurations.csv",
    ]
    statuses = {address: client.get(address).status_code for address in addresses}
    beside = client.get(f"/compare/?devices=google-pixel-8,{slugs[0]}").content.decode()

    assert [json.loads(text)["results"] for text in texts] == [[]] * len(texts)
    assert set(statuses.values()) == {404}, statuses
    assert "Pixel" not in beside
    assert "Pixel" not in client.get("/?device=google").content.decode()


@pytest.mark.slow
def test_a_toggled_choice_rewrites_files_at_most_once_an_hour(
    client: Client, participant: Participant, settings: Any
) -> None:
    settings.FRONTRUNNER_RARE_BELOW = 5
    send(participant)
    exports.create_export()

    for number in range(12):
        send(participant, show_model=number % 2 == 0)

    # Named once, and masked again.
    assert set(StoredFile.objects.filter(table="devices").values_list("marked", flat=True)) == {2}
    assert client.get("/devices/google-pixel-8/").status_code == 404
