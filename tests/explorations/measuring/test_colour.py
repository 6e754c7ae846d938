"""Explorations of an application that runs over colour beside depth."""

import shutil
from pathlib import Path
from typing import Any

import pytest
from django.core.exceptions import ValidationError

from crowd.explorations import forms, lease_api, services, space_choice
from crowd.explorations.measuring.measurement import CannotMeasureHereError, find_packs
from crowd.explorations.models import Exploration
from crowd.fronts import sequences
from pareto import Space
from slam.datasets import open_sequence
from slam.datasets.formats.pack import colour_folder
from tests.builders.explorations import shipped_space
from tests.slam.tiny import write_tiny_pack

SPACE = shipped_space("elasticfusion")


@pytest.fixture
def coloured(unsaved: Exploration, tmp_path: Path, settings: Any) -> Exploration:
    """An exploration of elasticfusion that could be created, over a sequence with colour."""
    pack = write_tiny_pack(tmp_path, colour=True)
    settings.FRONTRUNNER_SEQUENCES = [tmp_path]
    unsaved.application, unsaved.space = "elasticfusion", SPACE
    unsaved.sequence_sha256 = open_sequence(pack).sha256
    return unsaved


def test_a_lease_lists_the_chunks_of_the_colour(coloured: Exploration) -> None:
    exploration = services.create(coloured)

    lease = lease_api.begin_lease(exploration.reference_device, b'{"lease_version": 2}')

    assert lease is not None
    assert lease.application == "elasticfusion"
    assert lease.configuration == Space.from_dict(SPACE).default
    [sequence] = lease.sequences
    assert sequence.colour is not None
    assert len(sequence.colour.chunks) == 3
    for chunk in sequence.colour.chunks:
        assert sequences.open_chunk(chunk.sha256) is not None


def test_without_colour_it_cannot_be_explored(coloured: Exploration, tmp_path: Path) -> None:
    exploration = services.create(coloured)
    shutil.rmtree(colour_folder(tmp_path / "tiny"))

    with pytest.raises(ValidationError, match="has no colour"):
        services.create(services.clone(exploration))
    with pytest.raises(CannotMeasureHereError, match="has no colour"):
        find_packs(exploration, exploration.learned_on)


def test_colour_is_no_sequence_of_its_own(coloured: Exploration) -> None:
    assert [pack["sha256"] for pack in forms.available_packs()] == [coloured.sequence_sha256]
    assert "elasticfusion" in [path.stem for path in space_choice.shipped_spaces()]
