"""Fronts in the administration: each role's buttons, the pages before a decision, and the log."""

import json
from collections.abc import Callable
from typing import Any

import pytest
from django.core.files.uploadedfile import SimpleUploadedFile
from django.test import Client
from django.urls import reverse

from crowd.audit.models import AuditEntry
from crowd.fronts import services
from crowd.fronts.models import FrontVersion
from tests.crowd.documents import front_document
from tests.crowd.roles import browser_of

LogIn = Callable[[str], Client]


@pytest.fixture
def log_in(db: None) -> LogIn:
    """A browser of somebody on the staff with that role (none where it is empty)."""

    return browser_of


@pytest.fixture
def draft(db: None, pack: dict[str, Any]) -> FrontVersion:
    return services.create_draft(front_document(pack, version="1"))


def address(name: str, front: FrontVersion) -> str:
    return reverse(f"admin:fronts_frontversion_{name}", args=[front.pk])


def take(browser: Client, front: FrontVersion, step: str, **form: str) -> Any:
    return browser.post(address("step", front), {"step": step} | form, follow=True)


def test_an_editor_submits_and_a_publisher_publishes(log_in: LogIn, draft: FrontVersion) -> None:
    editor, publisher = log_in("editor"), log_in("publisher")
    assert "Submit for review" in editor.get(address("change", draft)).content.decode()

    assert "is in review" in take(editor, draft, "submit", note="please look").content.decode()
    page = editor.get(address("change", draft)).content.decode()
    assert 'value="publish"' not in page
    assert take(editor, draft, "publish").status_code == 403
    assert FrontVersion.objects.get().state == "in-review"

    assert 'value="publish"' in publisher.get(address("change", draft)).content.decode()
    assert "clients measure it now" in take(publisher, draft, "publish").content.decode()

    assert FrontVersion.objects.get().state == "published"
    assert [(row.actor, row.note) for row in AuditEntry.objects.all()[:2]] == [
        ("publisher-1", ""),
        ("editor-1", "please look"),
    ]


@pytest.mark.parametrize("step", ["retire", "publish-again"])
def test_an_editor_decides_nothing_about_what_is_published(
    log_in: LogIn, front: FrontVersion, step: str
) -> None:
    editor = log_in("editor")

    assert take(editor, front, step).status_code == 403
    assert f'value="{step}"' not in editor.get(address("change", front)).content.decode()
    assert [row.state for row in FrontVersion.objects.all()] == ["published"]


@pytest.mark.parametrize("name", ["change", "manifest", "manifest_json", "compare", "export"])
def test_nobody_else_sees_anything_of_a_draft(log_in: LogIn, draft: FrontVersion, name: str) -> None:
    assert log_in("").get(address(name, draft)).status_code == 403
    stranger = Client().get(address(name, draft))
    assert (stranger.status_code, "/admin/login/" in stranger["Location"]) == (302, True)


def test_nobody_else_takes_a_step_or_imports(log_in: LogIn, draft: FrontVersion) -> None:
    nobody = log_in("")

    assert take(nobody, draft, "submit").status_code == 403
    assert nobody.get(reverse("admin:fronts_frontversion_import")).status_code == 403
    assert FrontVersion.objects.get().state == "draft"


def test_a_step_that_the_state_does_not_allow_says_so(log_in: LogIn, draft: FrontVersion) -> None:
    answer = take(log_in("publisher"), draft, "publish").content.decode()

    assert "kfusion-1 is draft and cannot become published" in answer
    assert FrontVersion.objects.get().state == "draft"


def test_the_preview_is_what_clients_read_after_publication(
    log_in: LogIn, draft: FrontVersion, client: Client
) -> None:
    publisher = log_in("publisher")
    preview = publisher.get(address("manifest_json", draft)).content
    assert "kfusion-1" in publisher.get(address("manifest", draft)).content.decode()

    for step in ("submit", "publish"):
        take(publisher, draft, step)

    assert client.get("/api/v1/manifest").content == preview


def test_a_draft_is_compared_with_what_clients_measure_now(
    log_in: LogIn, front: FrontVersion, draft: FrontVersion
) -> None:
    page = log_in("editor").get(address("compare", draft)).content.decode()

    assert "kfusion-1 against kfusion-test" in page
    assert "0 configurations gained" in page.replace("\N{NO-BREAK SPACE}", " ")


def test_an_exported_file_can_be_imported(log_in: LogIn, draft: FrontVersion, pack: dict[str, Any]) -> None:
    editor = log_in("editor")
    document = json.loads(editor.get(address("export", draft)).content)
    assert document == front_document(pack, version="1")
    document["version"] = "2"

    file = SimpleUploadedFile("front.json", json.dumps(document).encode())
    answer = editor.post(reverse("admin:fronts_frontversion_import"), {"file": file}, follow=True)

    assert "kfusion-2 is a draft" in answer.content.decode()
    assert FrontVersion.objects.get(slug="kfusion-2").configurations.count() == 3


def test_a_bad_file_is_refused_with_its_reason(log_in: LogIn) -> None:
    file = SimpleUploadedFile("front.json", b"{}")

    answer = log_in("editor").post(reverse("admin:fronts_frontversion_import"), {"file": file})

    assert "application: is missing" in answer.content.decode()
    assert not FrontVersion.objects.exists()


def test_an_earlier_version_is_published_again_with_one_button(
    log_in: LogIn, front: FrontVersion, client: Client
) -> None:
    answer = take(log_in("publisher"), front, "publish-again")

    assert "kfusion-1 is published" in answer.content.decode()
    assert client.get("/api/v1/manifest").json()["front_version"] == "kfusion-1"


def test_a_draft_is_discarded_with_one_button(log_in: LogIn, draft: FrontVersion) -> None:
    assert "The draft is gone" in take(log_in("editor"), draft, "discard").content.decode()
    assert not FrontVersion.objects.exists()


def test_the_log_is_shown_and_never_edited(log_in: LogIn, draft: FrontVersion) -> None:
    publisher = log_in("publisher")
    entry = AuditEntry.objects.get()

    assert "drafted" in publisher.get(reverse("admin:audit_auditentry_changelist")).content.decode()
    change = reverse("admin:audit_auditentry_change", args=[entry.pk])
    assert publisher.post(change, {"actor": "nobody"}).status_code == 403
    assert AuditEntry.objects.get().actor == "command line"
