"""The private link of an installation, which shows its exact model, and its data."""

import json
from typing import Any

import pytest
from django.test import Client
from django.utils import timezone

from crowd.devices.models import Installation
from crowd.results.privacy.own_page import own_page_path
from tests.builders.documents import submission_document
from tests.builders.participant import API, Participant
from tests.builders.rare import Join, masked, measure

pytestmark = pytest.mark.usefixtures("rare_below_five")


def test_an_installation_reads_what_it_is(client: Client, front: Any, join: Join) -> None:
    who = join()
    answer = who.get("/me")

    assert answer.json() == {
        "installation_id": who.installation_id,
        "app": "client_kit",
        "app_version": "0.1.0",
        "consent_version": 1,
        "show_model": False,
        "page": own_page_path(Installation.objects.get()),
    }
    assert answer.headers["Cache-Control"] == "no-store"
    assert client.get(f"{API}/me").status_code == 401


def test_the_own_link_shows_the_own_model(client: Client, front: Any, join: Join) -> None:
    who = join()
    answer = who.submit(submission_document())
    state = who.get(f"/submissions/{answer.json()['submission_id']}").json()

    page = client.get(state["page"])

    assert state["device"] == masked()
    assert page.status_code == 200
    assert page["X-Robots-Tag"] == "noindex"
    content = page.content.decode()
    assert "Google Pixel 8" in content
    assert "Others see it as" in content
    assert "Google Tensor G3 device" in content


def test_an_own_link_is_nobody_elses(client: Client, front: Any, join: Join, installation: Any) -> None:
    other = join()
    measure(other)
    path = own_page_path(installation)

    assert "Pixel 8" not in client.get(path).content.decode()
    forged = path.replace(installation.pk.hex, other.installation_id.replace("-", ""))
    assert client.get(forged).status_code == 404


def test_an_own_link_ends_with_the_installation(
    client: Client, participant: Participant, installation: Any
) -> None:
    measure(participant)
    path = own_page_path(installation)
    assert "Pixel 8" in client.get(path).content.decode()

    participant.delete("/me")

    assert client.get(path).status_code == 404


def test_an_own_link_works_after_the_token_was_revoked(
    client: Client, participant: Participant, installation: Any
) -> None:
    measure(participant)
    path = own_page_path(installation)

    Installation.objects.update(revoked_at=timezone.now())

    assert "Pixel 8" in client.get(path).content.decode()


def test_own_data_name_the_own_device(front: Any, join: Join) -> None:
    who = join()
    measure(who)

    answer = who.get("/me/data")
    content = b"".join(answer.streaming_content) if answer.streaming else answer.content

    assert "husky-build-77" in json.dumps(json.loads(content))
