"""Fronts of protocol 2: a fixed number of pairs, and a reference trajectory with a band for each point."""

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest
from django.core.management import call_command
from django.db import IntegrityError, connection, transaction
from django.test import Client

from crowd.fronts import selectors
from crowd.fronts.content import front_file
from crowd.fronts.content.front_file import InvalidFrontError
from crowd.fronts.models import FrontVersion, Trajectory
from crowd.fronts.publishing import guards, services
from tests.crowd.documents import BAND, FRAMES, front_document, trajectory
from tests.crowd.participant import API

SHIPPED = Path(__file__).parents[2] / "fixtures" / "fronts"


@pytest.fixture
def second(db: None, pack: dict[str, Any]) -> FrontVersion:
    """A published front of protocol 2."""
    return services.publish_content(front_document(pack))[0]


@pytest.mark.parametrize("name", ["max_repeats", "precision", "max_seconds"])
def test_members_of_version_1_alone_are_refused_with_the_remedy(
    db: None, pack: dict[str, Any], name: str
) -> None:
    document = front_document(pack)
    document["protocol"][name] = 1

    with pytest.raises(InvalidFrontError, match=f"protocol.{name}: version 2 has a fixed number of pairs"):
        services.create_draft(document)


@pytest.mark.parametrize("number", [0, 3])
def test_another_version_of_the_protocol_is_refused(db: None, pack: dict[str, Any], number: int) -> None:
    document = front_document(pack)
    document["protocol"]["version"] = number

    with pytest.raises(InvalidFrontError, match=r"protocol\.version: Expected `int` [<>]= "):
        services.create_draft(document)


@pytest.mark.parametrize("member", ["band", "trajectory"])
def test_each_configuration_needs_both_members(db: None, pack: dict[str, Any], member: str) -> None:
    document = front_document(pack)
    del document["configurations"][1][member]

    with pytest.raises(InvalidFrontError, match=rf"configurations\[1\].{member} of best: is missing, add it"):
        services.create_draft(document)


@pytest.mark.parametrize("member", ["band", "trajectory"])
def test_version_1_refuses_both_members(db: None, pack: dict[str, Any], member: str) -> None:
    document = front_document(pack)
    document["configurations"][1][member] = {"band": BAND, "trajectory": trajectory()}[member]

    with pytest.raises(InvalidFrontError, match=f"{member} of best: belongs to protocol 2: leave it out"):
        services.create_draft(document)


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
    client: Client, second: FrontVersion, pack: dict[str, Any]
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


def test_a_front_of_protocol_1_has_neither_member(client: Client, front: FrontVersion) -> None:
    for point in client.get(f"{API}/manifest").json()["configurations"]:
        assert set(point) == {"name", "parameters", "predicted"}


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


def test_an_exported_front_imports_as_the_same_content(
    db: None, pack: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    draft = services.create_draft(front_document(pack, "1"))
    path = tmp_path / "front.json"

    call_command("front", "export", draft.slug, out=path)
    services.discard(draft)
    call_command("front", "import", str(path))

    assert FrontVersion.objects.get().digest == draft.digest
    assert "[0.01, 0.5, 0.1],\n" in path.read_text()  # a position is one line


def test_a_rolled_back_front_keeps_its_trajectories(second: FrontVersion) -> None:
    again = services.publish_again(second)

    assert [point.trajectory_sha256 for point in selectors.front_in_any_state(again.pk).points] == [
        point.trajectory_sha256 for point in selectors.front_in_any_state(second.pk).points
    ]


def test_a_published_front_keeps_its_band_and_trajectories(second: FrontVersion) -> None:
    statements = (
        f"UPDATE {guards.CONFIGURATION} SET band = 1",
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


def test_the_digests_of_the_fronts_that_ship_do_not_change() -> None:
    digests = {path.stem: front_file.digest(front_file.read(path)) for path in SHIPPED.glob("kfusion-*.json")}

    assert digests["kfusion-1"] == "2149cad3641ec14f454dfc08b9b0aceeb318e3ad0524b3a958b9852e99db81d6"
    assert digests["kfusion-2"] == "a7160cdb53d933ba7da41457457c7a2ac905fb38fcfccf32710139d157ae8d96"
