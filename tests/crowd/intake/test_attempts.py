"""Counts of browsers by step: they are anonymous, and no client can fill the table."""

import json
from datetime import UTC, date, datetime
from typing import Any

import pytest
from django.test import Client

from crowd.devices import attempts
from crowd.devices.attempts import Attempt
from crowd.devices.models import AttemptCount
from crowd.results.opendata.tables import TABLES
from tests.builders.participant import API
from tests.crowd.refusals import problem
from tests.crowd.roles import browser_of

pytestmark = pytest.mark.django_db
PHONE = {"gpu_vendor": "qualcomm", "gpu_architecture": "adreno-7xx", "browser": "Chrome"}
KEY = ("step", "reason", "gpu_vendor", "gpu_architecture", "browser", "count")


def send(client: Client, **attempt: Any) -> Any:
    return client.post(f"{API}/attempts", json.dumps(attempt), content_type="application/json")


def rows() -> list[tuple[Any, ...]]:
    return list(AttemptCount.objects.order_by("pk").values_list(*KEY))


def test_an_attempt_is_counted_by_its_day_alone(client: Client) -> None:
    answers = [send(client, step="opened", **PHONE), send(client, step="opened", **PHONE)]

    assert [(answer.status_code, answer.content) for answer in answers] == [(204, b"")] * 2
    row = AttemptCount.objects.get()
    assert (row.count, type(row.day)) == (2, date)
    assert {field.name for field in AttemptCount._meta.concrete_fields} == {"id", "day", *KEY}


def test_a_reason_counts_where_something_ended(client: Client) -> None:
    send(client, step="failed", reason="wrong_results", **PHONE)
    send(client, step="finished", reason="error", **PHONE)

    chip = ("qualcomm", "adreno-7xx", "Chrome", 1)
    assert rows() == [("failed", "wrong_results", *chip), ("finished", "", *chip)]


def test_words_that_are_not_listed_count_as_other(client: Client) -> None:
    send(client, step="opened", gpu_vendor="acme", gpu_architecture="rocket", browser="Visit My Site")
    send(client, step="opened", gpu_vendor="arm", gpu_architecture="rocket", browser="Mozilla Firefox 145")
    send(client, step="opened", gpu_vendor=None, browser="")
    send(client, step="opened", gpu_vendor=" ARM ", gpu_architecture="VALHALL", browser="Safari")

    assert [row[2:5] for row in rows()] == [
        ("other", "other", "other"),
        ("arm", "other", "Firefox"),
        ("", "", ""),
        ("arm", "valhall", "Safari"),
    ]


def test_a_day_has_so_many_rows_and_no_more(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(attempts, "MOST_ROWS", 2)
    for vendor in ("arm", "nvidia", "intel", "amd", "apple"):
        send(client, step="opened", gpu_vendor=vendor)
    send(client, step="opened", gpu_vendor="arm")

    assert [(vendor, count) for *_, vendor, _, _, count in rows()] == [
        ("arm", 2),
        ("nvidia", 1),
        ("other", 3),
    ]


@pytest.mark.parametrize(
    ("attempt", "field"),
    [
        ({"step": "hacked"}, "step"),
        ({}, None),
        ({"step": "failed", "reason": "visit my site"}, "reason"),
        ({"step": "opened", "browser": "x" * 201}, "browser"),
        ({"step": "opened", "gpu_vendor": 7}, "gpu_vendor"),
    ],
)
def test_what_is_not_an_attempt_is_refused(
    client: Client, attempt: dict[str, Any], field: str | None
) -> None:
    answer = send(client, **attempt)

    status, code, named = problem(answer)
    assert (status, code) == (400, "invalid_field")
    assert named == field or field is None
    assert rows() == []


def test_an_address_is_counted_so_often_an_hour(client: Client, settings: Any) -> None:
    settings.FRONTRUNNER_ATTEMPTS_PER_HOUR = 2

    answers = [send(client, step="opened") for _ in range(3)]

    assert [answer.status_code for answer in answers] == [204, 204, 429]
    assert rows()[0][-1] == 2


def test_administrators_see_how_many_came_how_far(client: Client) -> None:
    for step, reason in (("opened", None), ("opened", None), ("began", None), ("failed", "hidden")):
        attempts.count(Attempt(step=step, reason=reason))  # type: ignore[arg-type]
    for _ in range(3):
        attempts.count(Attempt(step="failed", reason="wrong_results", **PHONE))
    found = attempts.summary(AttemptCount.objects.all())

    assert found.steps == (
        ("opened", 2), ("unsupported", 0), ("began", 1), ("failed", 4), ("finished", 0),
    )  # fmt: skip
    assert found.reasons == (("failed", "wrong_results", 3), ("failed", "hidden", 1))
    assert found.wrong_results == (("qualcomm", "adreno-7xx", "Chrome", 3),)
    page = browser_of("editor").get("/admin/devices/attemptcount/?gpu_vendor=qualcomm").content.decode()
    assert "<caption>Wrong results</caption>" in page
    assert "<td>adreno-7xx</td><td>Chrome</td><td>3</td>" in page
    assert '<th scope="row">opened</th><td>0</td>' in page


def test_counts_are_part_of_no_open_data() -> None:
    assert not [table.name for table in TABLES if "attempt" in table.name]


def test_the_day_is_that_of_utc(client: Client) -> None:
    before = datetime.now(UTC).date()
    send(client, step="opened")

    assert before <= AttemptCount.objects.get().day <= datetime.now(UTC).date()
