"""What a start does with the fronts that ship: published on a fresh server, offered on every other."""

import json
from pathlib import Path
from typing import Any

import pytest
from django.test import Client

from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing import second_person, services
from crowd.operations import first_run
from tests.builders.documents import front_document
from tests.crowd.roles import browser_of


@pytest.fixture
def shipped(pack: dict[str, Any], settings: Any, tmp_path: Path) -> Path:
    """The file of kfusion-2, the one front that ships."""
    settings.FRONTRUNNER_FRONTS = tmp_path / "fronts"
    settings.FRONTRUNNER_FRONTS.mkdir()
    path = settings.FRONTRUNNER_FRONTS / "kfusion-2.json"
    path.write_text(json.dumps(front_document(pack, version="2")))
    return path


def states() -> dict[str, str]:
    return dict(FrontVersion.objects.order_by("slug").values_list("slug", "state"))


def test_a_fresh_server_publishes_them_and_a_second_start_changes_nothing(db: None, shipped: Path) -> None:
    assert list(first_run.publish_shipped_fronts()) == ["Published the front kfusion-2: 3 configurations"]
    assert list(first_run.publish_shipped_fronts()) == []
    assert states() == {"kfusion-2": "published"}


def test_an_upgrade_offers_a_new_one_and_clients_go_on_with_the_operator_s(
    front: FrontVersion, shipped: Path, client: Client
) -> None:
    (line,) = first_run.publish_shipped_fronts()

    assert "is a draft here" in line
    assert [row.slug for row in second_person.offered()] == ["kfusion-2"]
    assert "frontrunner admin front publish kfusion-2" in line
    assert states() == {"kfusion-2": "draft", "kfusion-test": "published"}
    assert client.get("/api/v1/manifest").json()["front_version"] == "kfusion-test"


def test_a_discarded_offer_does_not_come_back(front: FrontVersion, shipped: Path) -> None:
    list(first_run.publish_shipped_fronts())
    services.discard(FrontVersion.objects.get(slug="kfusion-2"))

    assert list(first_run.publish_shipped_fronts()) == []
    assert states() == {"kfusion-test": "published"}


def test_an_operator_s_front_of_the_same_name_stays(db: None, shipped: Path, pack: dict[str, Any]) -> None:
    own = front_document(pack, version="2", provenance={"note": "made here"})
    services.publish_content(own)

    (line,) = first_run.publish_shipped_fronts()

    assert line.endswith("yours stays")
    assert FrontVersion.objects.get().content.provenance == {"note": "made here"}


def test_the_front_that_clients_measure_is_marked_everywhere(
    front: FrontVersion, pack: dict[str, Any], client: Client
) -> None:
    newer, _ = services.publish_content(front_document(pack, version="3"))
    administration = browser_of("publisher")

    assert client.get("/fronts/").content.decode().count("measured now") == 1
    assert "clients measure it now" in client.get("/fronts/kfusion-3/").content.decode()
    assert "clients measure it now" not in client.get(f"/fronts/{front.slug}/").content.decode()
    rows = administration.get("/admin/fronts/frontversion/").content.decode()
    assert rows.count('alt="True"') == rows.count('alt="False"') == 1
    page = "/admin/fronts/frontversion/{}/manifest/"
    assert "Measured now" in administration.get(page.format(newer.pk)).content.decode()
    assert "measure kfusion-3 now" in administration.get(page.format(front.pk)).content.decode()
