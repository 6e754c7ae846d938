"""Evaluations as CSV and JSON: what everybody may read of them."""

import csv
import json

import pytest

from crowd.explorations import services
from crowd.explorations.measuring.measurement import Measurement
from crowd.explorations.models import Exploration
from crowd.explorations.objectives import MEASURED, without_ratios
from crowd.explorations.outcomes import exports
from slam import isolated
from slam.public_text import without_folders
from tests.builders.explorations import record

FAILURE = "=2+5: /srv/frontrunner/slam/run.py is gone"


@pytest.fixture
def failed(exploration: Exploration) -> Exploration:
    record(services.pending_evaluations(exploration)[0], FAILURE, worker="host-7:4711")
    return exploration


def first(lines: str) -> dict[str, str]:
    return next(csv.DictReader(lines.splitlines()))


def test_everybody_reads_neither_who_measured_nor_where_files_lie(failed: Exploration) -> None:
    table, objects = "".join(exports.csv_lines(failed)), "".join(exports.json_lines(failed))

    for text in (table, objects):
        assert "host-7" not in text
        assert "/srv" not in text
    assert json.loads(objects)[0]["error"] == "=2+5: run.py is gone"


def test_the_staff_reads_both(failed: Exploration) -> None:
    row = first("".join(exports.csv_lines(failed, staff=True)))

    assert (row["worker"], row["error"]) == ("host-7:4711", f"'{FAILURE}")


def test_a_text_that_a_spreadsheet_would_compute_begins_with_an_apostrophe(failed: Exploration) -> None:
    row = first("".join(exports.csv_lines(failed)))

    assert row["error"] == "'=2+5: run.py is gone"
    assert row["state"] == "failed"


def test_whatever_was_measured_has_a_column(exploration: Exploration) -> None:
    values = without_ratios(dict.fromkeys((*MEASURED, "energy_joules"), 0.25))
    stages = dict.fromkeys(isolated.STAGES, 0.5)
    measured = Measurement(values, stages, {"name": "Bench CPU"})
    record(services.pending_evaluations(exploration)[0], measured)

    row = first("".join(exports.csv_lines(exploration)))
    document = json.loads("".join(exports.json_lines(exploration)))[0]

    for name in (*values, *(f"{stage}_seconds" for stage in stages)):
        assert float(row[name]) == document[name] > 0


def test_numbers_stay_numbers(exploration: Exploration) -> None:
    assert [exports._cell(value) for value in (-1.5, None, "-1", "@a", "a=1")] == [
        *(-1.5, None, "'-1", "'@a", "a=1"),
    ]


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ('File "/srv/frontrunner/slam/run.py", line 3', 'File "run.py", line 3'),
        (r"C:\Users\anna\cache\kernel.cl: no", "kernel.cl: no"),
        ("--space pareto/spaces/kfusion.json", "--space pareto/spaces/kfusion.json"),
        ("--space=/home/anna/space.json --out /tmp/a/b.json", "--space=space.json --out b.json"),
        ("0.02 m/s, 3/4 of 1 / 2", "0.02 m/s, 3/4 of 1 / 2"),
        ("killed by SIGABRT", "killed by SIGABRT"),
    ],
)
def test_of_an_absolute_path_its_last_part_is_shown(text: str, shown: str) -> None:
    assert without_folders(text) == shown
