"""An application that needs colour: its fronts name the pack of it, and its manifest says where it is."""

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

import msgspec
import pytest
from django.test import Client

from crowd.dashboard.templatetags.units import pack_size
from crowd.fronts import selectors
from crowd.fronts.content import front_file
from crowd.fronts.content.front_file import InvalidFrontError
from crowd.fronts.publishing import services
from crowd.fronts.sequences import SequenceError
from slam.datasets.formats.pack import Pack, colour_folder
from tests.builders.documents import elastic_front_document, front_document, write_pack
from tests.builders.participant import API
from tests.slam.tiny import write_tiny_pack

FAST = {"icp_weight": 100, "fast_odometry": True}


@pytest.fixture(scope="module")
def coloured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_pack(tmp_path_factory.mktemp("coloured"), colour=True)


@pytest.fixture
def sequence(coloured: Path, own_data_folder: Path) -> Path:
    """The coloured sequence among those of the server."""
    folder = own_data_folder / "sequences"
    shutil.copytree(coloured.parent, folder, dirs_exist_ok=True)
    return folder / coloured.name


def document(sequence: Path) -> dict[str, Any]:
    """A front of elasticfusion over that sequence."""
    return elastic_front_document(sequence)


def test_the_manifest_lists_the_files_of_the_colour(client: Client, db: None, sequence: Path) -> None:
    front, _ = services.publish_content(document(sequence))

    listed = client.get(f"{API}/manifest", {"application": "elasticfusion"}).json()["sequence"]

    assert listed["sha256"] == Pack(sequence).sha256
    beside = json.loads((colour_folder(sequence) / "pack.json").read_text())
    assert (listed["colour"]["name"], listed["colour"]["sha256"]) == (beside["name"], beside["sha256"])
    for chunk in listed["colour"]["chunks"]:
        content = b"".join(client.get(chunk["url"]))  # type: ignore[arg-type]
        assert hashlib.sha256(content).hexdigest() == chunk["sha256"]
    assert len(listed["colour"]["chunks"]) == len(beside["chunks"])
    # Its file names the same colour: published again it is the same front.
    again = services.publish_again(front)
    stored = selectors.content(selectors.front_in_any_state(again.pk))
    assert msgspec.to_builtins(stored.sequence) == document(sequence)["sequence"]
    assert front_file.digest(stored) == again.digest


def test_pages_tell_of_the_colour_that_is_downloaded_too(client: Client, db: None, sequence: Path) -> None:
    services.publish_content(document(sequence))
    front = selectors.current("elasticfusion")
    assert front is not None

    page = client.get(f"/fronts/{front.slug}/").content.decode()

    packs = (sequence, colour_folder(sequence))
    files = [path for pack in packs for path in (pack / "chunks").iterdir()]
    assert pack_size(front.sequence) == sum(path.stat().st_size for path in files)
    assert front.sequence["colour"]["sha256"] in page


def test_a_front_that_names_no_colour_though_its_application_needs_it(db: None, sequence: Path) -> None:
    wanted = document(sequence)
    del wanted["sequence"]["colour_sha256"]

    with pytest.raises(InvalidFrontError, match=r"sequence\.colour_sha256: is missing"):
        services.create_draft(wanted)


@pytest.mark.parametrize("harm", ["absent", "damaged", "another"])
def test_a_front_whose_colour_cannot_be_had_is_refused(db: None, sequence: Path, harm: str) -> None:
    wanted = document(sequence)
    beside = colour_folder(sequence)
    if harm == "absent":
        shutil.rmtree(beside)
    elif harm == "damaged":
        chunk = json.loads((beside / "pack.json").read_text())["chunks"][1]["sha256"]
        (beside / "chunks" / chunk).write_bytes(b"nothing")
    else:
        wanted["sequence"]["colour_sha256"] = "0" * 64

    with pytest.raises(SequenceError, match="colour"):
        services.create_draft(wanted)


def test_parameters_are_checked(db: None, sequence: Path) -> None:
    wrong = document(sequence)
    wrong["configurations"][1]["parameters"] = FAST | {"depth_cutoff": -1}

    with pytest.raises(InvalidFrontError, match="depth_cutoff"):
        services.create_draft(wrong)


def test_who_names_no_application_measures_kfusion_or_what_is_there(
    client: Client, db: None, sequence: Path
) -> None:
    assert client.get(f"{API}/manifest").status_code == 404
    services.publish_content(document(sequence))
    alone = client.get(f"{API}/manifest").json()
    services.publish_content(front_document(write_pack(sequence.parent)))

    both = client.get(f"{API}/manifest").json()

    assert alone["application"] == "elasticfusion"
    assert both["application"] == "kfusion"
    assert both["sequence"]["colour"] is None
