"""The administration's first page, and JSON as tables on its pages."""

from typing import Any

import pytest
from django.contrib.admin import site
from django.test import Client
from django.urls import reverse

from crowd.administration import sections
from crowd.fronts.models import FrontVersion
from crowd.results.intake import packing
from crowd.results.models import MeasurementSession, Run, Submission
from tests.builders.documents import submission_document
from tests.builders.participant import Participant
from tests.crowd.roles import browser_of
from tests.dashboard.reading import text

pytestmark = pytest.mark.django_db


def change(row: Any) -> str:
    return reverse(f"admin:{row._meta.app_label}_{row._meta.model_name}_change", args=[row.pk])


def page_of(browser: Client, row: Any) -> str:
    answer = browser.get(change(row))
    assert answer.status_code == 200
    return answer.content.decode()


def test_every_list_has_its_place_on_the_first_page(admin_client: Client) -> None:
    app_list = admin_client.get(reverse("admin:index")).context["app_list"]

    assert [section["name"] for section in app_list] == ["Publish", "Explore", "Review", "People"]
    shown = {model["object_name"] for section in app_list for model in section["models"]}
    assert shown == {model._meta.object_name for model in site._registry}


def test_a_list_without_a_place_is_shown_all_the_same() -> None:
    strange = {"object_name": "Strange", "name": "Strange things"}

    (section,) = sections.group_by_purpose([{"app_label": "elsewhere", "models": [strange]}], "/admin/")

    assert (section["name"], section["models"]) == ("Other", [strange | {"meaning": ""}])


def test_the_first_page_shows_only_what_the_account_may_see() -> None:
    publisher = text(browser_of("publisher").get(reverse("admin:index")))
    without_role = text(browser_of("").get(reverse("admin:index")))

    assert "review, publish and retire fronts" in publisher
    assert "accounts and passwords" not in publisher
    assert "Ask an administrator for a role" in without_role


def test_the_first_page_shows_the_health_and_what_clients_measure(
    admin_client: Client, front: FrontVersion
) -> None:
    page = text(admin_client.get(reverse("admin:index")))

    assert f"clients measure {front.slug}" in page
    assert "no periodic task has run yet start both" in page


def test_the_lists_of_one_application_are_as_django_arranges_them(admin_client: Client) -> None:
    page = admin_client.get(reverse("admin:app_list", args=["fronts"]))

    assert [one["app_label"] for one in page.context["app_list"]] == ["fronts"]


def test_configurations_of_a_front_are_rows_of_tables(admin_client: Client, front: FrontVersion) -> None:
    page = page_of(admin_client, front)

    assert '<th scope="col">volume_resolution</th>' in page
    assert '<th scope="row">accurate</th>' in page
    assert '<th scope="row">warmup_frames</th>' in page
    assert "Raw JSON" in page
    before_raw = page.split('<details class="raw">')[0]
    assert "{&quot;" not in before_raw


def test_what_was_sent_is_shown_as_tables(admin_client: Client, participant: Participant) -> None:
    document = submission_document()
    document["sessions"][0]["samples"] = [{"t": 0.5, "temperature_c": 31.25}]
    document["sessions"][0]["unheard_of"] = {"deep": [{"<b>": "<i>"}]}
    assert participant.submit(document).status_code == 202

    session, submission = MeasurementSession.objects.get(), Submission.objects.get()
    page = page_of(admin_client, session)

    assert "<td>0.5</td><td>31.25</td>" in page
    assert f'<th scope="row">model</th><td>{session.description.raw["model"]}</td>' in page
    assert "&lt;b&gt;" in page
    assert "<i>" not in page
    assert '<th scope="row">submission_id</th>' in page_of(admin_client, submission)


def test_the_times_of_a_run_are_shown_by_stage(admin_client: Client, participant: Participant) -> None:
    participant.submit(submission_document())
    run = Run.objects.first()
    assert run is not None

    page = page_of(admin_client, run)

    assert '<th scope="col">mean (ms)</th>' in page
    for name in ("frame", *packing.decompress(run.frames.content).stages):
        assert f'<th scope="row">{name}</th>' in page


def test_strings_of_a_device_are_a_table_on_its_page(admin_client: Client, participant: Participant) -> None:
    participant.submit(submission_document())
    model = MeasurementSession.objects.get().device

    page = page_of(admin_client, model)

    assert '<th scope="row">manufacturer</th>' in page
    assert "Device descriptions" in page
