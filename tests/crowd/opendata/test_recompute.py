"""`recompute.py` of an export finds every published figure, from the files alone."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from crowd.fronts.publishing.services import publish_content
from crowd.results.opendata import exports
from tests.builders.crowds import Join, crowd, send
from tests.builders.documents import front_document, session_document
from tests.crowd.exported import copy, table

FILES = ("summaries.parquet", "sessions.parquet", "figures.parquet", "recompute.py")


def four_pairs() -> list[dict[str, Any]]:
    """The runs of a session whose four ratios differ a little."""
    runs: list[dict[str, Any]] = session_document(pairs=4)["runs"]
    for place, run in enumerate(runs):
        run["frame_us"] = [time + 20 * place for time in run["frame_us"]]
    return runs


@pytest.fixture
def folder(front: Any, join: Join, pack: dict[str, Any], tmp_path: Path, settings: Any) -> Path:
    """The files of an export whose figures need every step."""
    settings.FRONTRUNNER_RARE_BELOW = 2
    crowd(join, {"Pixel 8": [80 / 9, 80 / 9.5, 80 / 11, 80 / 15], "Pixel 7": [80 / 12, 80 / 14]})
    # Six sessions of a day, of which five count. The second network has two installations.
    eager, other, alone = join("lab"), join("lab"), join()
    for best_us in (10_000, 10_100, 10_200, 10_300, 10_400, 12_000):
        send(eager, session_document(best_us=best_us))
    send(other, session_document(best_us=10_600))
    for best_us in (9_000, 9_300, 9_900):
        send(alone, session_document(best_us=best_us), device="Pixel 6")
    publish_content(front_document(pack, version="four", pairs=4))
    send(join(), session_document("kfusion-four", runs=four_pairs()), device="Pixel 5")
    export = exports.create_export()
    for name in FILES:
        copy(export, name, tmp_path)
    return tmp_path


def recompute(folder: Path) -> subprocess.CompletedProcess[str]:
    """What the program of the export does in `folder`."""
    command = [sys.executable, "recompute.py"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def test_every_published_figure_is_found_and_another_one_is_an_error(folder: Path) -> None:
    figures = table("figures")
    assert len(figures) == 4
    # The cases differ: an interval, a robust mean, a repeatability, an interval of one session.
    for name in ("low", "repeat_low", "session_low"):
        assert sum(row[name] is not None for row in figures) == 1, name

    done = recompute(folder)

    assert done.returncode == 0, done.stderr
    assert done.stdout == "4 figures, all as published\n"
    program = folder / "recompute.py"
    program.write_text(program.read_text().replace("1.345 *", "1.3 *"))
    assert "log_ratio" in recompute(folder).stderr


def test_groups_of_one_on_a_masked_device_have_no_number(folder: Path) -> None:
    groups: dict[str, list[Any]] = {}
    masked = {row["device"] for row in table("devices") if row["masked"]}
    for row in table("sessions"):
        groups.setdefault(row["device"], []).append(row["network_group"])

    assert len(masked) == 2
    assert all(set(groups[device]) == {None} for device in masked)
    named = [numbers for device, numbers in groups.items() if device not in masked]
    assert sorted(len(set(numbers)) for numbers in named) == [2, 5]
