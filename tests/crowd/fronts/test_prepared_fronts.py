"""What a front needs for clients: for each point a trajectory, a band and times of its stages."""

import hashlib
import json
from collections.abc import Callable
from typing import Any

import pytest
from django.db import IntegrityError, connection, transaction
from django.test import Client

from crowd.fronts import selectors
from crowd.fronts.content import front_file
from crowd.fronts.content.front_file import InvalidFrontError
from crowd.fronts.models import FrontVersion, Trajectory
from crowd.fronts.publishing import guards, services
from tests.builders.documents import BAND, FRAMES, adaptive_front_document, front_document, trajectory
from tests.builders.participant import API
from tests.shipped import FIXTURES


@pytest.mark.parametrize("check", [front_file.check, front_file.check_draft])
def test_a_front_of_protocol_1_is_refused_with_the_remedy(
    pack: dict[str, Any], check: Callable[[dict[str, Any]], object]
) -> None:
    document = front_document(pack)
    document["protocol"] |= {"version": 1, "repeats": 2, "max_repeats": 6}

    with pytest.raises(InvalidFrontError) as refused:
        check(document)

    assert "set it to 2 and protocol.repeats to 4" in str(refused.value)
    assert "frontrunner admin front prepare kfusion-test" in str(refused.value)


@pytest.mark.parametrize("kind", ["configurations", "probes"])
@pytest.mark.parametrize("member", ["band", "trajectory", "on_sequence"])
def test_a_draft_may_lack_what_a_published_front_needs(
    db: None, pack: dict[str, Any], kind: str, member: str
) -> None:
    document = front_document(pack)
    document["probes"] = [document["configurations"].pop()]
    place = {"configurations": 1, "probes": 0}[kind]
    point = document[kind][place]
    del (point["predicted"] if member == "on_sequence" else point)[member]

    draft = services.create_draft(document)

    complaint = rf"{kind}\[{place}\]\.(predicted\.)?{member} of .*: is missing: prepare the draft"
    with pytest.raises(InvalidFrontError, match=complaint):
        services.submit(draft)
    with pytest.raises(InvalidFrontError, match=complaint):
        services.publish_content(document)


@pytest.mark.parametrize(
    ("member", "value", "complaint"),
    [
        ("band", 0, "band: Expected `float` > 0"),
        ("band", "wide", "band: Expected `float`, got `str`"),
        ("band", float("inf"), "band: must be a finite number"),
        (
            "trajectory",
            trajectory()[1:],
            "trajectory of best: has 99 positions: give one for each of the 100",
        ),
        ("trajectory", [[0.0, 0.0]] * FRAMES, "Expected `array` of length 3, got 2"),
        ("trajectory", [[0.0, 0.0, None]] * FRAMES, "Expected `float`, got `null`"),
        ("trajectory", [[0.0, 0.0, float("nan")]] * FRAMES, "must be a finite number"),
    ],
)
def test_a_wrong_band_or_trajectory_is_refused_by_name(
    db: None, pack: dict[str, Any], member: str, value: Any, complaint: str
) -> None:
    document = front_document(pack)
    document["configurations"][1][member] = value

    with pytest.raises(InvalidFrontError) as refused:
        services.create_draft(document)

    assert complaint in str(refused.value)
    assert f".{member}" in str(refused.value)


def test_the_manifest_names_each_trajectory_by_its_digest(
    client: Client, front: FrontVersion, pack: dict[str, Any]
) -> None:
    points = client.get(f"{API}/manifest").json()["configurations"]

    for point, sent in zip(points, front_document(pack)["configurations"], strict=True):
        content = client.get(point["trajectory"]["url"])
        assert point["band"] == BAND
        assert hashlib.sha256(content.content).hexdigest() == point["trajectory"]["sha256"]
        assert content.json() == sent["trajectory"]
        assert content.headers["Content-Type"] == "application/json"
        assert "immutable" in content.headers["Cache-Control"]
        etag = content.headers["ETag"]
        again = client.get(point["trajectory"]["url"], headers={"If-None-Match": etag})
        assert (again.status_code, again.content) == (304, b"")
    assert client.get(f"{API}/fronts/kfusion-test").json()["configurations"] == points


def test_a_trajectory_is_public_once_its_front_is(client: Client, db: None, pack: dict[str, Any]) -> None:
    draft = services.create_draft(front_document(pack))
    address = f"/trajectories/{Trajectory.objects.first()}"

    assert client.get(address).status_code == 404
    services.publish(services.submit(draft))
    assert client.get(address).status_code == 200
    assert client.get(f"/trajectories/{'0' * 64}").status_code == 404


def test_trajectories_of_replaced_and_discarded_drafts_are_deleted(db: None, pack: dict[str, Any]) -> None:
    services.create_draft(front_document(pack))
    assert Trajectory.objects.count() == 3

    changed = front_document(pack)
    changed["configurations"][1]["trajectory"] = changed["configurations"][0]["trajectory"]
    draft = services.create_draft(changed)
    assert Trajectory.objects.count() == 2

    services.discard(draft)
    assert not Trajectory.objects.exists()


def test_whole_numbers_make_the_same_front(db: None, pack: dict[str, Any]) -> None:
    floats, whole = (front_document(pack) for _ in range(2))
    floats["configurations"][1] |= {"band": 1.0, "trajectory": [[1.0, 0.0, 2.0]] * FRAMES}
    whole["configurations"][1] |= {"band": 1, "trajectory": [[1, 0, 2]] * FRAMES}

    front, _ = services.publish_content(whole)

    assert services.publish_content(floats) == (front, False)


def test_the_share_of_frames_left_out_is_kept_and_told(
    client: Client, db: None, pack: dict[str, Any]
) -> None:
    document = adaptive_front_document(pack)
    front, _ = services.publish_content(document)

    stored = selectors.content(selectors.front_in_any_state(front.pk))
    manifest = client.get(f"{API}/manifest").json()

    assert front_file.digest(stored) == front.digest == front_file.digest(front_file.check(document))
    assert {one["name"]: one.get("skipped") for one in manifest["configurations"]} == {
        "default": None,
        "best": None,
        "adaptive": 0.6,
        "accurate": None,
    }
    stripped = front_file.without_preparation(stored)
    assert {point.skipped for point in stripped.configurations} == {None}


def test_a_rolled_back_front_keeps_its_trajectories(front: FrontVersion) -> None:
    again = services.publish_again(front)

    assert [point.trajectory_sha256 for point in selectors.front_in_any_state(again.pk).points] == [
        point.trajectory_sha256 for point in selectors.front_in_any_state(front.pk).points
    ]


def test_a_published_front_keeps_its_band_and_trajectories(front: FrontVersion) -> None:
    statements = (
        f"UPDATE {guards.CONFIGURATION} SET skipped = 0.5",
        f"UPDATE {guards.CONFIGURATION} SET trajectory_id = NULL",
        f"UPDATE {guards.TRAJECTORY} SET positions = '[]'",
    )
    for statement in statements:
        with pytest.raises(IntegrityError), transaction.atomic(), connection.cursor() as cursor:
            cursor.execute(statement)


def test_an_altered_trajectory_is_not_published(db: None, pack: dict[str, Any]) -> None:
    draft = services.submit(services.create_draft(front_document(pack)))
    guards.drop()
    Trajectory.objects.filter(configurations__name="best").update(positions=json.dumps(trajectory(0.7)))

    with pytest.raises(services.FrontConflictError, match="does not match its digest"):
        services.publish(draft)


def test_every_shipped_front_can_be_measured() -> None:
    for path in (FIXTURES / "fronts").glob("*.json"):
        front_file.check(front_file.read(path))
