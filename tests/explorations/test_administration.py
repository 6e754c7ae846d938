"""What an administrator does with explorations in the browser: create, steer, choose points, issue tokens."""

import json
from html import unescape
from typing import Any

import pytest
from django.test import Client
from django.urls import reverse

from crowd.audit.models import AuditEntry
from crowd.celery import app
from crowd.explorations import forms, services, space_choice
from crowd.explorations.measuring import tokens
from crowd.explorations.models import Exploration, ReferenceDevice
from crowd.explorations.outcomes import publishing
from crowd.fronts.models import FrontVersion
from tests.builders.explorations import finish, record, run_to_the_end
from tests.crowd.roles import browser_of

ADD = "admin:explorations_exploration_add"


def address(name: str, exploration: Exploration) -> str:
    return reverse(f"admin:explorations_exploration_{name}", args=[exploration.pk])


def step(browser: Client, exploration: Exploration, name: str, **form: str) -> str:
    answer = browser.post(address("step", exploration), {"step": name} | form, follow=True)
    exploration.refresh_from_db()
    return str(answer.content.decode())


def wish(exploration: Exploration, **changes: Any) -> dict[str, Any]:
    """The form filled in to create such an exploration over the shipped space."""
    filled = forms.initial_values(exploration) | {"design_space": "kfusion"} | changes
    filled["reference_device"] = exploration.reference_device.pk
    return {name: value for name, value in filled.items() if value is not None and value is not False}


def sent(queue_name: str) -> list[Any]:
    with app.connection_for_read() as broker, broker.SimpleQueue(queue_name) as queue:
        return [queue.get(block=False).payload[0] for _ in range(queue.qsize())]


def test_the_administrator_reads_lists_and_rows(administrator: Client, explored: Exploration) -> None:
    row = explored.evaluations.first()
    assert row is not None
    for name in ("referencedevice", "exploration", "evaluation"):
        assert administrator.get(reverse(f"admin:explorations_{name}_changelist")).status_code == 200
    for name, key in (
        ("exploration", explored.pk),
        ("evaluation", row.pk),
        ("referencedevice", explored.reference_device.pk),
    ):
        assert administrator.get(reverse(f"admin:explorations_{name}_change", args=[key])).status_code == 200


def test_the_form_offers_what_is_there_with_defaults(administrator: Client, unsaved: Exploration) -> None:
    page = administrator.get(reverse(ADD)).content.decode()

    assert '<option value="kfusion" selected>kfusion: 9 parameters, 1,800,000 configurations</option>' in page
    assert '<option value="elasticfusion-loops">' in page
    assert "tiny: 12 frames" in page
    assert 'value="60"' in page
    assert "bench" in page


def test_a_created_exploration_is_what_the_form_said_and_its_measurements_are_sent(
    administrator: Client, unsaved: Exploration, unread_queues: None, committing: Any
) -> None:
    with committing():
        answer = administrator.post(
            reverse(ADD), wish(unsaved, method="bayesian", max_runtime_ms="200", random_first="4")
        )

    assert answer.status_code == 302, answer.context["errors"]
    created = Exploration.objects.get()
    assert (created.application, created.space["name"]) == ("kfusion", "kfusion")
    assert (created.sequence, created.sequence_sha256) == (unsaved.sequence, unsaved.sequence_sha256)
    assert created.objectives == ["ate_max", "runtime"]
    assert created.limits == {"ate_max": 0.05, "runtime": 0.2}
    assert created.options == {"initial": 4}
    assert (created.method, created.budget, created.batch) == ("bayesian", 6, 4)
    assert sent("bench") == [[row.pk] for row in services.pending_evaluations(created)]


REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"frames": "13"}, "tiny has 12"),
    ({"minimised": []}, "This field is required"),
    ({"budget": "0"}, "0 is too small: give 1 or more"),
    ({"pack": "elsewhere 0"}, "Select a valid choice"),
    ({"more_limits": "ate_mean"}, "ate_mean: give NAME=NUMBER"),
    ({"more_limits": "ate_mean=inf"}, "ate_mean=inf: give NAME=NUMBER"),
    ({"more_limits": "speed=3"}, "speed"),
    ({"more_options": "trees=few"}, "trees=few: give NAME=NUMBER"),
    ({"more_options": "leaves=3"}, "no option"),
]


def test_an_exploration_that_cannot_run_is_refused_in_the_form(
    administrator: Client, unsaved: Exploration, subtests: pytest.Subtests
) -> None:
    for change, complaint in REFUSED:
        with subtests.test(str(change)):
            page = administrator.post(reverse(ADD), wish(unsaved, **change)).content.decode()

            assert complaint in page
            assert not Exploration.objects.exists()


def test_a_clone_starts_from_the_same_wishes(
    administrator: Client, exploration: Exploration, unread_queues: None
) -> None:
    page = administrator.get(reverse(ADD), {"clone": exploration.pk})
    form = page.context["adminform"].form

    assert form.initial["design_space"] == f"exploration-{exploration.pk}"
    assert form.initial["budget"] == 6
    assert form.initial["warm_start_from"] is None
    filled = wish(exploration, design_space=form.initial["design_space"], budget="7")
    assert administrator.post(reverse(ADD), filled).status_code == 302
    clone = Exploration.objects.latest("pk")
    assert (clone.space, clone.budget) == (exploration.space, 7)


def test_a_new_exploration_can_start_from_what_another_measured(
    administrator: Client, explored: Exploration, unread_queues: None
) -> None:
    form = administrator.get(reverse(ADD), {"warm_start": explored.pk}).context["adminform"].form
    assert form.initial["warm_start_from"] == explored.pk

    filled = wish(explored, **{name: form.initial[name] for name in ("design_space", "warm_start_from")})
    assert administrator.post(reverse(ADD), filled).status_code == 302

    warm = Exploration.objects.latest("pk")
    assert warm.warm_start_from == explored
    assert warm.evaluations.filter(phase="known").exists()


def test_an_exploration_is_steered_by_buttons(
    administrator: Client, exploration: Exploration, unread_queues: None
) -> None:
    assert 'value="pause"' in administrator.get(address("change", exploration)).content.decode()

    assert "paused" in step(administrator, exploration, "pause")
    assert exploration.state == "paused"
    page = step(administrator, exploration, "resume")
    assert (exploration.state, 'value="resume"' in page) == ("running", False)
    step(administrator, exploration, "raise", budget="9")
    assert exploration.budget == 9
    step(administrator, exploration, "cancel")
    assert exploration.state == "cancelled"
    assert "Nothing was done" in step(administrator, exploration, "resume")
    assert exploration.state == "cancelled"


@pytest.mark.slow
def test_a_budget_that_is_no_larger_one_is_refused(administrator: Client, exploration: Exploration) -> None:
    for budget in ("", "many", "6", "1000001", "9" * 30, "9" * 5000):
        assert "Nothing was done" in step(administrator, exploration, "raise", budget=budget), budget[:9]
        assert exploration.budget == 6


def test_a_finished_exploration_goes_on_with_a_larger_budget(
    administrator: Client, explored: Exploration, unread_queues: None, committing: Any
) -> None:

    with committing():
        step(administrator, explored, "raise", budget="8")

    assert explored.state == "running"
    assert [explored.pk] in sent("crowd")


def test_failures_are_measured_once_more(
    administrator: Client, exploration: Exploration, unread_queues: None
) -> None:

    row = services.pending_evaluations(exploration)[0]
    record(row, "killed by SIGABRT")
    assert 'value="retry"' in administrator.get(address("change", exploration)).content.decode()

    assert "failures to measure again: 1" in step(administrator, exploration, "retry")

    row.refresh_from_db()
    assert (row.state, row.error) == ("pending", "")


def test_points_are_chosen_measured_again_and_made_a_draft(
    administrator: Client, explored: Exploration, unread_queues: None
) -> None:
    page = administrator.get(address("points", explored)).content.decode()
    for name in ("default", "best", "accurate"):
        assert f'value="{name}"' in page
    candidates, _ = publishing.candidates(explored)
    chosen = {f"name-{row.key}": row.name for row in candidates if row.name in {"default", "best"}}

    answer = administrator.post(
        address("points", explored), chosen | {"act": "measure", "times": "2"}, follow=True
    )
    assert "4 measurements to come" in answer.content.decode().replace("\N{NO-BREAK SPACE}", " ")
    finish(services.pending_evaluations(explored))
    answer = administrator.post(address("points", explored), chosen | {"act": "draft"}, follow=True)

    assert "Front kfusion-1 is a draft" in answer.content.decode()
    front = FrontVersion.objects.get()
    assert [point.name for point in front.content.configurations] == ["default", "best"]
    assert {point.predicted.measurements for point in front.content.configurations} == {4}


def test_a_choice_that_cannot_be_published_says_why_and_is_kept_in_the_form(
    administrator: Client, explored: Exploration
) -> None:
    candidates, _ = publishing.candidates(explored)
    first = f"name-{candidates[0].key}"

    page = administrator.post(address("points", explored), {first: "mine", "act": "draft"})

    assert "default is missing: every speedup" in page.content.decode()
    assert 'value="mine"' in page.content.decode()
    assert not FrontVersion.objects.exists()


def test_before_anything_was_measured_there_is_nothing_to_choose(
    administrator: Client, exploration: Exploration
) -> None:
    page = administrator.get(address("points", exploration)).content.decode()

    assert "the default configuration was not measured" in page
    assert "Nothing was measured yet" in page


@pytest.mark.slow
def test_an_editor_explores_and_drafts_but_does_not_publish(explored: Exploration) -> None:
    editor = browser_of("editor")
    candidates, _ = publishing.candidates(explored)
    chosen = {f"name-{row.key}": row.name for row in candidates if row.name}

    assert editor.get(reverse(ADD)).status_code == 200
    editor.post(address("points", explored), chosen | {"act": "draft"})

    front = FrontVersion.objects.get()
    publish = editor.post(reverse("admin:fronts_frontversion_step", args=[front.pk]), {"step": "publish"})
    assert (front.state, publish.status_code) == ("draft", 403)


def test_nobody_without_a_role_sees_or_steers(exploration: Exploration) -> None:
    visitor = browser_of("")

    for page in ("change", "points", "step"):
        assert visitor.get(address(page, exploration)).status_code == 403, page
        assert visitor.post(address(page, exploration), {"step": "cancel"}).status_code == 403, page
    exploration.refresh_from_db()
    assert exploration.state == "running"


def test_a_token_is_shown_once_and_can_be_revoked(administrator: Client, exploration: Exploration) -> None:
    device = exploration.reference_device
    page = reverse("admin:explorations_referencedevice_token", args=[device.pk])

    issued = administrator.post(page, {"act": "issue"})

    token = issued.content.decode().split("--token ")[1].split("<")[0].strip()
    assert tokens.device_of_token(token) == device
    assert "no-store" in issued["Cache-Control"]
    shown = administrator.get(reverse("admin:explorations_referencedevice_change", args=[device.pk]))
    assert token not in shown.content.decode()

    administrator.post(page, {"act": "revoke"})
    assert tokens.device_of_token(token) is None


def test_a_device_with_explorations_cannot_be_deleted(
    administrator: Client, exploration: Exploration
) -> None:
    delete = reverse("admin:explorations_referencedevice_delete", args=[exploration.reference_device.pk])

    assert administrator.post(delete, {"post": "yes"}).status_code == 403
    assert ReferenceDevice.objects.count() == 1


def test_json_is_never_asked_for(administrator: Client, exploration: Exploration) -> None:
    form = administrator.get(reverse(ADD), {"clone": exploration.pk}).context["adminform"].form

    shown = {field.name: unescape(str(field)) for field in form}
    assert "0.05" in json.dumps(exploration.limits)
    assert shown["max_error_cm"].count("5.0") == 1
    for name, text in shown.items():
        assert "{" not in text, name
        assert "<textarea" not in text, name


def test_a_clone_keeps_what_the_form_has_no_field_for(
    administrator: Client, unsaved: Exploration, unread_queues: None
) -> None:
    unsaved.application, unsaved.space = "other", space_choice.space_of_choice("kfusion")[1]
    unsaved.method, unsaved.options = "bayesian", {"initial": 3, "points": 8}
    unsaved.objectives = ["ate_max", "runtime", "ate_mean", "peak_memory_bytes"]
    unsaved.limits = {"ate_max": 0.04, "ate_mean": 0.02, "peak_memory_bytes": 2e9}
    first = services.create(unsaved)
    form = administrator.get(reverse(ADD), {"clone": first.pk}).context["adminform"].form

    answer = administrator.post(reverse(ADD), wish(first, design_space=form.initial["design_space"]))

    assert answer.status_code == 302, answer.context["errors"]
    clone = Exploration.objects.latest("pk")
    assert clone.pk != first.pk
    for name in ("application", "space", "objectives", "limits", "method", "options"):
        assert getattr(clone, name) == getattr(first, name), name


def test_the_opencl_device_stays_while_an_exploration_counts_on_it(
    administrator: Client, exploration: Exploration
) -> None:
    device = exploration.reference_device
    page = reverse("admin:explorations_referencedevice_change", args=[device.pk])
    form = {"name": "bench", "queue": "bench", "backend": "opencl", "opencl_device": "mali", "machines": "2"}

    refused = administrator.post(page, form).content.decode()

    assert f"bench measures exploration {exploration.pk} on opencl, its best device" in refused
    other = administrator.post(page, form | {"backend": "webgpu", "opencl_device": ""}).content.decode()
    assert "cannot change to webgpu, its best device now" in other
    assert administrator.post(page, form | {"opencl_device": ""}).status_code == 302
    device.refresh_from_db()
    assert (device.opencl_device, device.machines) == ("", 2)
    services.cancel(exploration)
    assert administrator.post(page, form).status_code == 302
    device.refresh_from_db()
    assert device.opencl_device == "mali"


def logged() -> list[tuple[str, str, str, str, str]]:
    """What the audit log says of explorations and their devices, oldest first."""
    rows = AuditEntry.objects.exclude(subject__startswith="account").order_by("pk")
    return [(row.actor, row.action, row.subject, row.from_state, row.to_state) for row in rows]


def test_each_step_of_an_exploration_is_logged(
    administrator: Client, exploration: Exploration, unread_queues: None
) -> None:
    for name, form in (("pause", {}), ("resume", {}), ("raise", {"budget": "9"}), ("cancel", {})):
        step(administrator, exploration, name, **form)
    step(administrator, exploration, "resume")  # refused

    subject = f"exploration {exploration.pk}"
    assert logged() == [
        ("root", "paused", subject, "running", "paused"),
        ("root", "resumed", subject, "paused", "running"),
        ("root", "budget raised", subject, "running", "running"),
        ("root", "cancelled", subject, "running", "cancelled"),
    ]
    assert AuditEntry.objects.get(action="budget raised").note == "searches up to 9 configurations"


def test_what_is_started_and_measured_again_is_logged(
    administrator: Client, unsaved: Exploration, unread_queues: None
) -> None:
    administrator.post(reverse(ADD), wish(unsaved))
    exploration = run_to_the_end(Exploration.objects.get())
    candidates, _ = publishing.candidates(exploration)
    administrator.post(
        address("points", exploration),
        {f"name-{candidates[0].key}": "default", "act": "measure", "times": "2"},
    )

    subject = f"exploration {exploration.pk}"
    assert logged() == [
        ("root", "started", subject, "", "running"),
        ("root", "measurements repeated", subject, "done", "running"),
    ]
    assert AuditEntry.objects.first().note == "2 further measurements"  # type: ignore[union-attr]


def test_each_token_of_a_device_is_logged_and_not_shown_there(administrator: Client, db: None) -> None:
    device = ReferenceDevice.objects.create(name="bench", queue="bench")
    page = reverse("admin:explorations_referencedevice_token", args=[device.pk])
    issued = administrator.post(page, {"act": "issue"})
    token = issued.content.decode().split("--token ")[1].split("<")[0].strip()
    administrator.post(page, {"act": "revoke"})
    administrator.post(page, {"act": "revoke"})  # there is none any more
    administrator.post(page, {"act": "issue"})
    administrator.post(
        reverse("admin:explorations_referencedevice_delete", args=[device.pk]), {"post": "yes"}
    )

    subject = "reference device bench"
    assert [row[:3] for row in logged()] == [
        ("root", "token issued", subject),
        ("root", "token revoked", subject),
        ("root", "token issued", subject),
        ("root", "token revoked", subject),
    ]
    assert AuditEntry.objects.first().note == "the device was deleted"  # type: ignore[union-attr]
    assert not ReferenceDevice.objects.exists()
    page_of_log = administrator.get(reverse("admin:audit_auditentry_changelist")).content.decode()
    assert subject in page_of_log
    assert token not in page_of_log
