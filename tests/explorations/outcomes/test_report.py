"""An exploration's outcome as Markdown."""

from typing import Any

import pytest

from crowd.explorations.outcomes.report import markdown
from tests.builders.searches import KNOWN, exploration, measure
from tests.crowd.conftest import pack

__all__ = ["pack"]

pytestmark = pytest.mark.django_db


def rows(text: str) -> list[list[str]]:
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line]


def test_it_counts_what_either_phase_found(pack: dict[str, Any]) -> None:
    search = exploration(pack)
    measure(search, KNOWN)
    measure(search, [(0.03, 0.05), (0.049, 0.01), (0.5, 0.004), None])

    table = rows(markdown(search))

    assert table[2] == ["random samples", "4", "1", "2", "2", "2"]
    assert table[3] == ["active learning", "0", "0", "0", "0", "0"]
    assert table[4] == ["both", "4", "1", "2", "2", "2"]


def test_it_lists_the_known_configurations_against_the_default(pack: dict[str, Any]) -> None:
    search = exploration(pack)
    measure(search, KNOWN)

    table = rows(markdown(search))[5:]

    assert table[0][:5] == ["configuration", "ms a frame", "speedup", "max ATE, cm", "measured"]
    assert table[0][5] == "volume_resolution"
    assert [line[:5] for line in table[2:]] == [
        ["fast1", "20.00", "5.0x", "4.00", "1"],
        ["fast2", "30.00", "3.3x", "20.00", "1"],
        ["fast3", "40.00", "2.5x", "30.00", "1"],
        ["default", "100.00", "1.0x", "2.00", "1"],
    ]
