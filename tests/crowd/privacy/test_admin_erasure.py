"""Administrators erase measurements of an installation, a network, a device model or a period."""

import io
from datetime import timedelta
from typing import Any

import pyarrow.parquet
import pytest
from django.contrib.auth.models import User
from django.test import Client
from django.urls import reverse
from django.utils import timezone

from crowd.audit.models import AuditEntry
from crowd.devices.models import DeviceModel, Installation
from crowd.results.models import (
    Cohort,
    DeviceSpeedup,
    MeasurementSession,
    Run,
    SessionSummary,
    StoredFile,
    Submission,
    Tombstone,
)
from crowd.results.opendata import exports
from crowd.results.privacy import erasure, selected_erasure
from crowd.results.privacy.selected_erasure import Selection
from tests.builders.crowds import Join, send
from tests.builders.documents import submission_document
from tests.builders.participant import Participant
from tests.crowd.roles import browser_of

PAGE = "/admin/results/tombstone/erase/"


@pytest.fixture
def staff(db: None) -> Client:
    browser = Client()
    browser.force_login(User.objects.create_superuser("root"))
    return browser


def measured(who: Participant, sessions: int = 1, device: str = "Pixel 8") -> Participant:
    """`who`, after it has sent `sessions`."""
    for _ in range(sessions):
        send(who, device=device)
    return who


def left() -> set[str]:
    """The ids of installations that have sessions."""
    keys = MeasurementSession.objects.values_list("installation_id", flat=True)
    return {str(key) for key in keys}


def post(staff: Client, **fields: str) -> Any:
    return staff.post(PAGE, {"reason": "made-up measurements"} | fields)


def test_a_network_is_erased_after_a_preview_and_a_confirmation(
    staff: Client, front: Any, join: Join
) -> None:
    hostile = [measured(join("spoiled"), sessions=2), measured(join("spoiled"))]
    honest = measured(join("another"))
    idle = join("spoiled")

    seen = post(staff, network="spoiled")

    page = seen.content.decode()
    assert Run.objects.count() == 16
    assert seen.context["preview"].installations == 3
    assert (seen.context["preview"].sessions, seen.context["preview"].runs) == (3, 12)
    assert seen.context["preview"].models == ["Google Pixel 8"]
    assert seen.context["preview"].figures == ["Google Pixel 8, kfusion-test, opencl, Mali-G715"]
    assert "Google Pixel 8" in page
    assert "Erase 3 sessions for good" in page

    done = post(staff, network="spoiled", confirm="1")

    assert done.status_code == 302
    assert left() == {honest.installation_id}
    assert Installation.objects.count() == 1
    assert (Submission.objects.count(), SessionSummary.objects.count()) == (1, 1)
    figure = DeviceSpeedup.objects.get()
    assert (figure.sessions, figure.installations) == (1, 1)
    for each in (*hostile, idle):
        assert each.get("/me/data").status_code == 401
    kinds = list(Tombstone.objects.values_list("kind", "single"))
    assert sorted(kinds) == [("installation", False)] * 3 + [("run", False)] * 12 + [("session", False)] * 3


def test_an_erasure_by_an_administrator_is_logged_without_ids(staff: Client, front: Any, join: Join) -> None:
    hostile = measured(join("spoiled"))

    post(staff, network="spoiled", confirm="1")

    last, first = AuditEntry.objects.all()[:2]
    assert (first.action, last.action) == ("measurements: erasing", "measurements: erased")
    assert first.actor == last.actor == "root"
    assert "1 installations, 1 sessions, 4 runs" in last.note
    assert "made-up measurements" in last.note
    assert not any(secret in str(vars(last)) for secret in ("spoiled", hostile.installation_id))


def test_the_list_of_installations_leads_to_the_page(staff: Client, front: Any, join: Join) -> None:
    erased, staying = measured(join()), measured(join())
    listed = reverse("admin:devices_installation_changelist")

    chosen = {"action": "erase", "_selected_action": [erased.installation_id]}
    page = staff.post(listed, chosen, follow=True)
    assert erased.installation_id in page.content.decode()
    post(staff, installations=page.context["form"].initial["installations"], confirm="1")

    assert left() == {staying.installation_id}
    assert Installation.objects.count() == 1


def test_a_device_model_is_erased_under_all_its_names(staff: Client, front: Any, join: Join) -> None:
    participant = measured(join(), device="Pixel 8")
    measured(join(), device="Pixel 7")
    measured(join(), device="Pixel 9")
    alias = DeviceModel.objects.get(slug="google-pixel-7")
    alias.canonical = DeviceModel.objects.get(slug="google-pixel-8")
    alias.save()

    post(staff, device="google-pixel-8", confirm="1")

    assert [row.description.model.slug for row in MeasurementSession.objects.all()] == ["google-pixel-9"]
    assert Installation.objects.count() == 3
    assert participant.get("/me/data").status_code == 200


@pytest.mark.slow
def test_a_period_of_one_network_is_erased(staff: Client, front: Any, join: Join) -> None:
    hostile, honest = measured(join("spoiled"), sessions=3), measured(join("another"), sessions=3)
    now = timezone.now()
    for who in (hostile, honest):
        sessions = MeasurementSession.objects.filter(installation=who.installation_id).order_by("pk")
        for days, session in enumerate(sessions):
            MeasurementSession.objects.filter(pk=session.pk).update(received_at=now - timedelta(days=days))
    middle = (now - timedelta(days=1, hours=1)).isoformat(), (now - timedelta(hours=1)).isoformat()

    post(staff, network="spoiled", since=middle[0], until=middle[1], confirm="1")

    assert MeasurementSession.objects.filter(installation=hostile.installation_id).count() == 2
    assert MeasurementSession.objects.filter(installation=honest.installation_id).count() == 3
    assert hostile.submit(submission_document()).status_code == 202


def test_what_arrives_after_the_preview_of_a_device_stays(staff: Client, front: Any, join: Join) -> None:
    participant = measured(join())
    seen = post(staff, device="google-pixel-8")
    fields = {field.name: field.value() for field in seen.context["form"] if field.value()}

    measured(participant)
    staff.post(PAGE, fields | {"confirm": "1"})

    assert MeasurementSession.objects.count() == 1


def test_another_session_of_the_day_counts_in_place_of_an_erased_one(
    staff: Client, front: Any, join: Join, settings: Any
) -> None:
    settings.FRONTRUNNER_SUBMISSIONS_PER_MINUTE = 0
    measured(join(), sessions=6)
    assert SessionSummary.objects.filter(counted=True).count() == 5
    first = MeasurementSession.objects.order_by("started_at", "pk")[0]
    MeasurementSession.objects.filter(pk=first.pk).update(received_at=timezone.now() - timedelta(days=9))

    post(staff, until=(timezone.now() - timedelta(days=8)).isoformat(), confirm="1")

    assert SessionSummary.objects.filter(counted=True).count() == 5
    assert DeviceSpeedup.objects.get().sessions == 5


def test_an_interrupted_erasure_is_finished_by_the_same_selection(
    staff: Client, front: Any, join: Join, monkeypatch: pytest.MonkeyPatch
) -> None:
    hostile = measured(join("spoiled"), sessions=3)
    erase, batches = erasure.erase_sessions, []

    def interrupted(keys: Any) -> None:
        batches.append(keys)
        if len(batches) == 2:
            raise KeyboardInterrupt
        erase(keys)

    monkeypatch.setattr(selected_erasure, "BATCH", 1)
    monkeypatch.setattr(erasure, "erase_sessions", interrupted)
    with pytest.raises(KeyboardInterrupt):
        selected_erasure.erase(Selection(network="spoiled"), "root", "made up")
    assert MeasurementSession.objects.count() == 2
    assert DeviceSpeedup.objects.get().sessions == 2
    assert not Cohort.objects.filter(stale=True).exists()
    assert hostile.submit(submission_document()).json()["code"] == "token_invalid"

    selected_erasure.erase(Selection(network="spoiled"), "root", "made up")

    assert not Installation.objects.exists()
    assert not DeviceSpeedup.objects.exists()
    assert Tombstone.objects.filter(kind="session").count() == 3


def test_the_open_data_lacks_what_an_administrator_erased(staff: Client, front: Any, join: Join) -> None:
    measured(join("spoiled"))
    honest = measured(join("another"))
    exports.create_export()
    session = MeasurementSession.objects.get(installation=honest.installation_id)

    post(staff, network="spoiled", confirm="1")

    assert StoredFile.objects.filter(stale=True).exists()
    content = Client().get("/data/latest/sessions.parquet").getvalue()
    rows = pyarrow.parquet.read_table(io.BytesIO(content)).to_pylist()
    assert [row["session"] for row in rows] == [str(session.uuid)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({}, "select installations, a network, a device model or a period"),
        ({"device": "nothing-1"}, "no device model has the slug &#x27;nothing-1&#x27;"),
        ({"installations": "abc"}, "not the id of an installation"),
        ({"installations": f"{'0' * 32} " * 101}, "101 installations: give at most 100"),
        ({"network": "x", "reason": ""}, "This field is required"),
    ],
)
def test_a_selection_that_is_refused(
    staff: Client, participant: Participant, fields: dict[str, str], text: str
) -> None:
    measured(participant)

    answer = post(staff, confirm="1", **fields)

    assert text in answer.content.decode()
    assert MeasurementSession.objects.count() == 1
    assert not AuditEntry.objects.filter(action__startswith="measurements").exists()


def test_a_selection_that_matches_nothing_cannot_be_confirmed(staff: Client, front: Any) -> None:
    page = post(staff, network="unknown").content.decode()

    assert "Nothing matches" in page
    assert 'name="confirm"' not in page


@pytest.mark.parametrize("role", ["editor", "publisher"])
def test_only_those_who_may_erase_do(front: Any, participant: Participant, role: str) -> None:
    measured(participant)
    Installation.objects.update(network="spoiled")
    browser = browser_of(role)

    assert browser.get(PAGE).status_code == 403
    assert post(browser, network="spoiled", confirm="1").status_code == 403
    assert MeasurementSession.objects.count() == 1


def test_the_page_is_linked_for_those_who_may(staff: Client) -> None:
    assert f'href="{PAGE}"' in staff.get(reverse("admin:results_tombstone_changelist")).content.decode()
    assert "condition" in staff.get(PAGE).content.decode()


def test_the_page_of_an_installation_shows_its_network(staff: Client, front: Any, join: Join) -> None:
    hostile, other = measured(join("spoiled")), measured(join("another"))

    page = staff.get(reverse("admin:devices_installation_change", args=[hostile.installation_id]))
    found = staff.get(reverse("admin:devices_installation_changelist"), {"q": "spoiled"})

    assert "spoiled" in page.content.decode()
    assert hostile.installation_id in found.content.decode()
    assert other.installation_id not in found.content.decode()
