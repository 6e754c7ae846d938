"""The errors to reach, as the page for authors of clients has them, are those of the front that ships."""

import json
import re
from pathlib import Path

from crowd.fronts import trajectories
from slam.datasets.formats.pack import Pack
from tests.shipped import KFUSION, LIVING_ROOM

PAGE = Path(__file__).parents[2] / "docs" / "data" / "protocol.md"


def test_the_errors_to_reach_are_those_of_the_shipped_references() -> None:
    number = r" ([0-9.]+) \|"
    rows = re.findall(rf"^\| `([\w-]+)` \|{number * 3}$", PAGE.read_text(), re.MULTILINE)
    front, pack = json.loads(KFUSION.read_text()), Pack(LIVING_ROOM)
    assert front["sequence"]["sha256"] == pack.sha256

    expected = []
    for point in front["configurations"]:
        errors = trajectories.errors(point["trajectory"], pack.truth)
        assert errors is not None
        numbers = (errors.ate_max, errors.ate_mean, errors.ate_rmse)
        expected.append((point["name"], *(f"{number:.6f}" for number in numbers)))

    assert rows == expected
