"""Publishing fronts, and that what is published stays."""

import json
from pathlib import Path
from typing import Any

import pytest
from django.core.management import CommandError, call_command

from crowd.fronts import selectors
from crowd.fronts.content.front_file import InvalidFrontError, digest
from crowd.fronts.models import Configuration, FrontVersion, FrozenFrontError
from crowd.fronts.publishing import services
from crowd.fronts.sequences import SequenceError
from tests.builders.documents import front_document


def test_a_front_is_published_with_its_content(front: FrontVersion, pack: dict[str, Any]) -> None:
    assert (front.slug, front.state) == ("kfusion-test", "published")
    assert front.sequence == pack
    assert front.digest == digest(front_document(pack))
    current = selectors.current("kfusion")
    assert current is not None
    assert [point.name for point in current.points] == ["default", "best", "accurate"]
    assert current.points[1].runtime == 0.01


def test_publishing_the_same_content_again_changes_nothing(front: FrontVersion, pack: dict[str, Any]) -> None:
    reordered = dict(reversed(front_document(pack).items()))

    again, new = services.publish_content(reordered)

    assert (again.pk, new, again.published_at) == (front.pk, False, front.published_at)


def test_other_content_under_a_published_version_is_refused(
    front: FrontVersion, pack: dict[str, Any]
) -> None:
    changed = front_document(pack)
    changed["configurations"][1]["predicted"]["runtime"] = 0.001

    with pytest.raises(services.FrontConflictError, match="another version"):
        services.publish_content(changed)


def test_a_draft_may_be_replaced_until_it_is_published(db: None, pack: dict[str, Any]) -> None:
    services.create_draft(front_document(pack))
    draft = services.create_draft(front_document(pack, provenance={"note": "better"}))

    assert selectors.current("kfusion") is None
    services.publish(services.submit(draft))
    assert FrontVersion.objects.get().content.provenance == {"note": "better"}


@pytest.mark.parametrize(
    ("member", "value"),
    [("document", "{}"), ("digest", "0" * 64), ("slug", "kfusion-2"), ("published_at", None)],
)
def test_a_published_front_cannot_be_saved_differently(front: FrontVersion, member: str, value: Any) -> None:
    setattr(front, member, value)

    with pytest.raises(FrozenFrontError):
        front.save()
    assert getattr(FrontVersion.objects.get(), member) != value


def test_a_published_front_cannot_be_deleted_or_updated_in_bulk(front: FrontVersion) -> None:
    with pytest.raises(FrozenFrontError):
        front.delete()
    with pytest.raises(FrozenFrontError):
        FrontVersion.objects.all().delete()
    with pytest.raises(FrozenFrontError):
        FrontVersion.objects.update(document="{}")
    assert FrontVersion.objects.get().document == front.document


def test_the_configurations_of_a_published_front_are_fixed(front: FrontVersion) -> None:
    best = front.configurations.get(name="best")
    best.skipped = 0.5

    with pytest.raises(FrozenFrontError):
        best.save()
    with pytest.raises(FrozenFrontError):
        best.delete()
    with pytest.raises(FrozenFrontError):
        front.configurations.update(skipped=0.5)
    with pytest.raises(FrozenFrontError):
        front.configurations.all().delete()
    with pytest.raises(FrozenFrontError):
        Configuration.objects.bulk_create([Configuration(front=front, name="new", position=9)])
    assert front.configurations.get(name="best").skipped is None
    assert front.configurations.count() == 3


@pytest.mark.parametrize(("ratio", "fastest"), [(0.05, "adaptive"), (0.9, "best")])
def test_the_fastest_on_the_reference_leaves_out_frames_where_that_is_faster(
    front: FrontVersion, pack: dict[str, Any], ratio: float, fastest: str
) -> None:
    document = front_document(pack, "newer")
    best = next(one for one in document["configurations"] if one["name"] == "best")
    times = best["predicted"]["on_sequence"] | dict.fromkeys(("runtime_ratio", "low", "high"), ratio)
    predicted = best["predicted"] | {"on_sequence": times}
    document["configurations"].append(best | {"name": "adaptive", "predicted": predicted})
    newer, _ = services.publish_content(document)

    assert selectors.fastest_on_reference(front.slug) == "best"
    assert selectors.fastest_on_reference(newer.slug) == fastest


def test_a_retired_front_is_not_current_and_cannot_be_changed(front: FrontVersion) -> None:
    services.retire(front)

    assert selectors.current("kfusion") is None
    assert selectors.front("kfusion-test") is not None
    front.document = "{}"
    with pytest.raises(FrozenFrontError):
        front.save()


def without(document: dict[str, Any], name: str) -> dict[str, Any]:
    return document | {"configurations": [c for c in document["configurations"] if c["name"] != name]}


def test_a_front_without_default_or_best_is_refused(db: None, pack: dict[str, Any]) -> None:
    for name in ("default", "best"):
        with pytest.raises(InvalidFrontError, match=name):
            services.publish_content(without(front_document(pack), name))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": "Version One"}, "version"),
        ({"protocol": {"version": 1}}, "protocol"),
        ({"configurations": []}, "default"),
        ({"sequence": {"name": "x", "sha256": "0"}}, "sha256"),
    ],
)
def test_a_front_that_is_none_is_refused(
    db: None, pack: dict[str, Any], changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(InvalidFrontError, match=message):
        services.publish_content(front_document(pack, **changes))
    assert not FrontVersion.objects.exists()


def test_a_front_measured_on_an_absent_sequence_is_refused(db: None, pack: dict[str, Any]) -> None:
    with pytest.raises(SequenceError, match="no pack elsewhere"):
        services.publish_content(front_document(pack | {"name": "elsewhere"}))


def test_a_damaged_sequence_is_not_published(db: None, pack: dict[str, Any], own_data_folder: Path) -> None:
    chunk = own_data_folder / "sequences" / pack["name"] / "chunks" / pack["chunks"][1]["sha256"]
    chunk.write_bytes(b"not")

    with pytest.raises(SequenceError, match="does not match its digest"):
        services.publish_content(front_document(pack))


def test_the_command_publishes_files(
    db: None, pack: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "kfusion-test.json"
    path.write_text(json.dumps(front_document(pack)))

    call_command("front", "publish", str(path), "--yes")
    call_command("front", "publish", str(path))

    assert capsys.readouterr().out.splitlines() == [
        "No front of kfusion is published now: kfusion-test is the first.",
        "Phones and other browsers cannot measure it: only the native client can.",
        "kfusion-test: published",
        "kfusion-test: already published, nothing changed",
    ]


def test_the_command_refuses_a_changed_file(
    front: FrontVersion, pack: dict[str, Any], tmp_path: Path
) -> None:
    path = tmp_path / "kfusion-test.json"
    path.write_text(json.dumps(front_document(pack, provenance={})))

    with pytest.raises(CommandError, match="give the changed front another version"):
        call_command("front", "publish", str(path))
    path.write_text("{")
    with pytest.raises(CommandError, match="cannot be read as JSON"):
        call_command("front", "publish", str(path))
