"""Fronts in the administration: each role's buttons, the pages before a decision, and the log."""

import json
from typing import Any

import pytest
from django.core.files.uploadedfile import SimpleUploadedFile
from django.test import Client
from django.urls import reverse

from crowd.audit.models import AuditEntry
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing import services
from tests.builders.documents import front_document, predict
from tests.crowd.roles import browser_of

pytestmark = pytest.mark.django_db


def address(name: str, front: FrontVersion) -> str:
    return reverse(f"admin:fronts_frontversion_{name}", args=[front.pk])


def take(browser: Client, front: FrontVersion, step: str, **form: str) -> Any:
    return browser.post(address("step", front), {"step": step} | form, follow=True)


def publish(browser: Client, front: FrontVersion, step: str = "publish", **form: str) -> Any:
    """Take a step that publishes, and confirm what its page shows."""
    shown = take(browser, front, step, **form).context["previews"]
    return take(browser, front, step, confirmed=shown[0].token, **form)


def text_of(answer: Any) -> str:
    return str(answer.content.decode()).replace("\N{NO-BREAK SPACE}", " ")


def slower(pack: dict[str, Any], version: str) -> dict[str, Any]:
    """A front whose best gains less over its default and has a larger error than the usual one."""
    document = front_document(pack, version=version)
    predict(document["configurations"][1], runtime=0.02, ate_max=0.045)
    return document


def test_an_editor_submits_and_a_publisher_publishes(draft: FrontVersion) -> None:
    editor, publisher = browser_of("editor"), browser_of("publisher")
    assert "Submit for review" in editor.get(address("change", draft)).content.decode()

    assert "is in review" in take(editor, draft, "submit", note="please look").content.decode()
    page = editor.get(address("change", draft)).content.decode()
    assert 'value="publish"' not in page
    assert take(editor, draft, "publish").status_code == 403
    assert FrontVersion.objects.get().state == "in-review"

    assert 'value="publish"' in publisher.get(address("change", draft)).content.decode()
    assert "clients measure it now" in publish(publisher, draft).content.decode()

    assert FrontVersion.objects.get().state == "published"
    assert [(row.actor, row.note) for row in AuditEntry.objects.all()[:2]] == [
        ("publisher-1", ""),
        ("editor-1", "please look"),
    ]


@pytest.mark.parametrize("step", ["retire", "publish-again"])
def test_an_editor_decides_nothing_about_what_is_published(front: FrontVersion, step: str) -> None:
    editor = browser_of("editor")

    assert take(editor, front, step).status_code == 403
    assert f'value="{step}"' not in editor.get(address("change", front)).content.decode()
    assert [row.state for row in FrontVersion.objects.all()] == ["published"]


@pytest.mark.parametrize("name", ["change", "manifest", "manifest_json", "compare", "export"])
def test_nobody_else_sees_anything_of_a_draft(draft: FrontVersion, name: str) -> None:
    assert browser_of("").get(address(name, draft)).status_code == 403
    stranger = Client().get(address(name, draft))
    assert (stranger.status_code, "/admin/login/" in stranger["Location"]) == (302, True)


def test_nobody_else_takes_a_step_or_imports(draft: FrontVersion) -> None:
    visitor = browser_of("")

    assert take(visitor, draft, "submit").status_code == 403
    assert visitor.get(reverse("admin:fronts_frontversion_import")).status_code == 403
    assert FrontVersion.objects.get().state == "draft"


def test_a_step_that_the_state_does_not_allow_says_so(draft: FrontVersion) -> None:
    answer = take(browser_of("publisher"), draft, "publish").content.decode()

    assert "kfusion-1 is draft and cannot become published" in answer
    assert FrontVersion.objects.get().state == "draft"


def test_the_preview_is_what_clients_read_after_publication(draft: FrontVersion, client: Client) -> None:
    publisher = browser_of("publisher")
    preview = publisher.get(address("manifest_json", draft)).content
    assert "kfusion-1" in publisher.get(address("manifest", draft)).content.decode()

    take(publisher, draft, "submit")
    publish(publisher, draft)

    assert client.get("/api/v1/manifest").content == preview


def test_a_draft_is_compared_with_what_clients_measure_now(front: FrontVersion, draft: FrontVersion) -> None:
    page = browser_of("editor").get(address("compare", draft)).content.decode()

    assert "kfusion-1 against kfusion-test" in page
    assert "0 configurations gained" in page.replace("\N{NO-BREAK SPACE}", " ")


def test_an_exported_file_can_be_imported(draft: FrontVersion, pack: dict[str, Any]) -> None:
    editor = browser_of("editor")
    document = json.loads(editor.get(address("export", draft)).content)
    assert document == front_document(pack, version="1")
    document["version"] = "2"

    file = SimpleUploadedFile("front.json", json.dumps(document).encode())
    answer = editor.post(reverse("admin:fronts_frontversion_import"), {"file": file}, follow=True)

    assert "kfusion-2 is a draft" in answer.content.decode()
    assert FrontVersion.objects.get(slug="kfusion-2").configurations.count() == 3


def test_a_bad_file_is_refused_with_its_reason() -> None:
    file = SimpleUploadedFile("front.json", b"{}")

    answer = browser_of("editor").post(reverse("admin:fronts_frontversion_import"), {"file": file})

    assert "application: is missing" in answer.content.decode()
    assert not FrontVersion.objects.exists()


def test_an_earlier_version_is_published_again_with_one_button(front: FrontVersion, client: Client) -> None:
    answer = publish(browser_of("publisher"), front, "publish-again")

    assert "kfusion-1 is published" in answer.content.decode()
    assert client.get("/api/v1/manifest").json()["front_version"] == "kfusion-1"


def test_publishing_asks_first_and_shows_what_changes(
    front: FrontVersion, pack: dict[str, Any], client: Client
) -> None:
    worse = services.submit(services.create_draft(slower(pack, "2")))
    publisher = browser_of("publisher")

    answer = take(publisher, worse, "publish", note="as agreed")

    page = text_of(answer)
    assert "Publish kfusion-2?" in page
    assert "kfusion-2 in place of kfusion-test" in page
    assert "speedup over default of best gets worse: 4.00x instead of 8.00x in kfusion-test" in page
    assert "largest error of best gets worse: 0.0450 m instead of 0.0400 m" in page
    assert 'value="as agreed"' in page
    assert client.get("/api/v1/manifest").json()["front_version"] == "kfusion-test"
    confirmed = answer.context["previews"][0].token
    take(publisher, worse, "publish", note="as agreed", confirmed=confirmed)
    assert client.get("/api/v1/manifest").json()["front_version"] == "kfusion-2"
    assert AuditEntry.objects.get(subject="kfusion-2", action="published").note == "as agreed"


def test_a_better_front_is_confirmed_without_a_warning(pack: dict[str, Any], draft: FrontVersion) -> None:
    services.publish_content(slower(pack, "0"))

    page = text_of(take(browser_of("publisher"), services.submit(draft), "publish"))

    assert "kfusion-1 in place of kfusion-0" in page
    assert "gets worse" not in page
    assert "unknown" not in page


def test_an_unknown_figure_of_either_best_is_warned_of(front: FrontVersion, pack: dict[str, Any]) -> None:
    document = front_document(pack, version="2")
    document["configurations"][1]["predicted"]["ate_max"] = None
    unknown = services.submit(services.create_draft(document))

    page = text_of(take(browser_of("publisher"), unknown, "publish"))

    assert "largest error of best is unknown in kfusion-2" in page


def test_a_confirmation_counts_only_for_what_was_shown(
    front: FrontVersion, draft: FrontVersion, pack: dict[str, Any]
) -> None:
    publisher = browser_of("publisher")
    services.submit(draft)
    seen = take(publisher, draft, "publish").context["previews"][0].token
    services.publish_content(slower(pack, "2"))

    page = text_of(take(publisher, draft, "publish", confirmed=seen))

    assert "The fronts changed since you looked at them" in page
    assert "kfusion-1 in place of kfusion-2" in page
    assert FrontVersion.objects.get(slug="kfusion-1").state == "in-review"


def test_publishing_from_the_list_asks_first_too(
    front: FrontVersion, draft: FrontVersion, pack: dict[str, Any]
) -> None:
    publisher, changelist = browser_of("publisher"), reverse("admin:fronts_frontversion_changelist")
    worse = services.submit(services.create_draft(slower(pack, "2")))
    form = {"action": "publish", "_selected_action": [draft.pk, worse.pk]}

    asked = publisher.post(changelist, form)

    assert "gets worse" in text_of(asked)
    assert FrontVersion.objects.get(slug="kfusion-2").state == "in-review"
    confirmed = [one.token for one in asked.context["previews"]]
    page = text_of(publisher.post(changelist, form | {"confirmed": confirmed}, follow=True))
    assert "Front kfusion-2 is published" in page
    assert "kfusion-1 is draft and cannot become published" in page


def test_publishing_again_asks_first_too(front: FrontVersion, pack: dict[str, Any], client: Client) -> None:
    better = front_document(pack, version="2")
    predict(better["configurations"][1], runtime=0.005)
    services.publish_content(better)

    page = text_of(take(browser_of("publisher"), front, "publish-again"))

    assert "kfusion-3 in place of kfusion-2" in page
    assert "8.00x instead of 16.00x" in page
    assert client.get("/api/v1/manifest").json()["front_version"] == "kfusion-2"


@pytest.mark.slow
def test_a_second_person_publishes_where_that_is_demanded(pack: dict[str, Any], settings: Any) -> None:
    settings.FRONTRUNNER_SECOND_PERSON = True
    first, second = browser_of("publisher"), browser_of("publisher", "publisher-2")
    front = services.create_draft(front_document(pack, version="1"), by="editor-1")
    take(first, front, "submit")

    assert "publisher-1 drafted or submitted kfusion-1" in text_of(publish(first, front))
    assert FrontVersion.objects.get().state == "in-review"

    publish(second, front)
    assert FrontVersion.objects.get().state == "published"

    page = text_of(publish(second, front, "publish-again"))
    assert "Front kfusion-2 is in review" in page
    assert "publisher-2 drafted or submitted" in text_of(
        publish(second, FrontVersion.objects.get(slug="kfusion-2"))
    )


def test_a_draft_is_discarded_with_one_button(draft: FrontVersion) -> None:
    assert "The draft is deleted" in take(browser_of("editor"), draft, "discard").content.decode()
    assert not FrontVersion.objects.exists()


def test_the_log_is_shown_and_never_edited(draft: FrontVersion) -> None:
    publisher = browser_of("publisher")
    entry = AuditEntry.objects.get(action="drafted")

    assert "drafted" in publisher.get(reverse("admin:audit_auditentry_changelist")).content.decode()
    change = reverse("admin:audit_auditentry_change", args=[entry.pk])
    assert publisher.post(change, {"actor": "visitor"}).status_code == 403
    assert AuditEntry.objects.get(pk=entry.pk).actor == "anna"
