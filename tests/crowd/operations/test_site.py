"""What surrounds API and pages: health, metrics, OpenAPI, admin, security headers."""

import json
from typing import Any

import pytest
from django.contrib.auth import get_user_model
from django.core.management import call_command
from django.test import Client
from django.urls import reverse

import crowd.settings
from crowd.api_pages.openapi import document
from crowd.audit.models import AuditEntry
from crowd.fronts.models import FrontVersion
from crowd.results.models import DeviceSpeedup, MeasurementSession, Run, SessionSummary, Submission
from tests.builders.documents import submission_document
from tests.builders.participant import API, Participant


def test_health_asks_nothing_of_the_database(
    client: Client, django_assert_num_queries: Any, db: None
) -> None:
    with django_assert_num_queries(0):
        assert client.get("/healthz").content == b"ok\n"


@pytest.mark.parametrize(
    ("origin", "status"),
    [
        ({"REMOTE_ADDR": "127.0.0.1"}, 200),
        ({"REMOTE_ADDR": "198.51.100.7"}, 400),
        ({"REMOTE_ADDR": "127.0.0.1", "HTTP_X_FORWARDED_FOR": "198.51.100.7"}, 400),
    ],
)
def test_a_public_server_answers_for_localhost_only_this_machine(
    client: Client, db: None, settings: Any, origin: dict[str, str], status: int
) -> None:
    settings.PUBLIC_HOSTS = ["frontrunner.example"]

    assert client.get("/metrics", HTTP_HOST="localhost", **origin).status_code == status


def test_readiness_tells_of_database_broker_and_the_last_task(
    client: Client, participant: Participant
) -> None:
    before = client.get("/readyz").json()
    participant.submit(submission_document())
    after = client.get("/readyz")

    assert before["seconds_since_last_task"] is None
    assert after.status_code == 200
    assert (after.json()["database"], after.json()["broker"]) == ("ok", "ok")
    assert after.json()["seconds_since_last_task"] >= 0
    assert after.json()["sessions_waiting"] == 0


def test_the_openapi_document_describes_every_address(client: Client) -> None:
    answer = client.get(f"{API}/openapi.json").json()

    assert answer["openapi"].startswith("3.1")
    assert {
        f"{API}/{path}"
        for path in (
            "manifest", "enrol", "submissions", "submissions:validate", "submissions/{key}", "me", "me/data",
            "me/runs/{key}", "speedups", "devices", "devices/{slug}", "compare", "fronts", "fronts/{version}",
        )
    } <= set(answer["paths"])  # fmt: skip


def test_the_openapi_document_refers_only_to_what_it_holds() -> None:
    described = document()
    text = json.dumps(described)

    for part in text.split('"#/components/schemas/')[1:]:
        assert part.split('"')[0] in described["components"]["schemas"]
    assert described["components"]["schemas"]["Run"]["properties"]["frame_us"]["type"] == "array"
    body = described["paths"][f"{API}/submissions"]["post"]["requestBody"]["content"]["application/json"]
    assert body["schema"] == {"$ref": "#/components/schemas/Submission"}


def test_the_docs_page_loads_nothing_from_elsewhere(client: Client, db: None) -> None:
    response = client.get(f"{API}/docs")

    assert response.status_code == 200
    page = response.content.decode()
    assert "/api/v1/submissions:validate" in page
    assert "https://" not in page.replace("http://testserver", "")


def test_every_answer_has_a_strict_policy(client: Client, db: None) -> None:
    policy = client.get("/healthz").headers["Content-Security-Policy"]

    assert "default-src 'self'" in policy
    assert "unsafe-eval" not in policy
    assert "'unsafe-inline'" not in policy.replace("style-src-attr 'unsafe-inline'", "")


@pytest.fixture
def administrator(db: None, client: Client, capsys: pytest.CaptureFixture[str]) -> Client:
    """Logged in with the password that first_admin printed."""
    call_command("first_admin")
    password = capsys.readouterr().out.split("password ")[1].split()[0]
    assert client.login(username="admin", password=password)
    return client


def test_the_first_administrator_is_made_once(
    db: None, settings: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    settings.PASSWORD_HASHERS = crowd.settings.PASSWORD_HASHERS
    call_command("first_admin")
    assert "password" in capsys.readouterr().out

    call_command("first_admin")

    assert "There is an administrator already" in capsys.readouterr().out
    assert get_user_model().objects.get().password.startswith("argon2")


@pytest.mark.slow
def test_the_admin_shows_everything_and_edits_no_raw_data(
    administrator: Client, participant: Participant
) -> None:
    participant.submit(submission_document())

    for model in (Submission, MeasurementSession, Run, SessionSummary, DeviceSpeedup, FrontVersion):
        name = f"admin:{model._meta.app_label}_{model._meta.model_name}"
        row = model.objects.first()
        assert row is not None
        assert administrator.get(reverse(f"{name}_changelist"), {"q": "pixel"}).status_code == 200
        page = administrator.get(reverse(f"{name}_change", args=[row.pk]))
        assert page.status_code == 200
        assert 'name="_save"' not in page.content.decode()
        assert administrator.get(reverse(f"{name}_add")).status_code == 403
        assert administrator.post(reverse(f"{name}_delete", args=[row.pk])).status_code == 403
    for path in ("devices_devicemodel", "devices_installation"):
        listed = administrator.get(reverse(f"admin:{path}_changelist"))
        (row,) = listed.context["cl"].result_list
        page = administrator.get(reverse(f"admin:{path}_change", args=[row.pk]))
        assert (listed.status_code, page.status_code) == (200, 200)


def test_a_token_can_be_revoked(administrator: Client, participant: Participant) -> None:
    for _ in range(2):  # what is revoked already is not logged again
        administrator.post(
            reverse("admin:devices_installation_changelist"),
            {"action": "revoke", "_selected_action": [participant.installation_id]},
        )

    assert participant.submit(submission_document()).json()["code"] == "token_invalid"
    entry = AuditEntry.objects.get(action="token revoked")
    assert (entry.actor, entry.subject) == ("admin", f"installation {participant.installation_id}")


def test_a_front_can_be_retired_in_the_admin(administrator: Client, front: FrontVersion) -> None:
    administrator.post(
        reverse("admin:fronts_frontversion_changelist"), {"action": "retire", "_selected_action": [front.pk]}
    )

    front.refresh_from_db()
    assert front.state == "retired"
