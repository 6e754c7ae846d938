"""Exports all evaluations of an exploration as CSV or JSON, line by line.

They are public, except for what only staff sees: the worker's process and host, folders in error messages,
and the phase of a measurement that is not finished.
"""

import csv
import json
from collections.abc import Iterator
from datetime import datetime
from typing import Any

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.objectives import MEASURED
from crowd.explorations.outcomes.public_rows import public_row
from crowd.records.record import members
from slam.isolated import STAGES
from wire.evaluation import EvaluationRow

COLUMNS = members(EvaluationRow, "column")
OBJECTIVES = (*MEASURED, "energy_joules")  # the last one only if a machine reports it
SEQUENCE_COLUMNS = ("ate_max", "lost", "runtime")  # such as ate_max@office, with several sequences
STAGE_SECONDS = tuple(f"{stage}_seconds" for stage in STAGES)
CHUNK = 500
FORMULA_START = ("=", "+", "-", "@", "\t", "\r")  # spreadsheets evaluate texts that start like this


class _Line:
    """A file for the csv module that returns each line."""

    def write(self, line: str) -> str:
        return line


def csv_lines(exploration: Exploration, staff: bool = False) -> Iterator[str]:
    """A line for each evaluation: objectives in SI units, a column for each parameter and stage.

    With several sequences, held-out ones included, each has the columns SEQUENCE_COLUMNS. A text that a
    spreadsheet would evaluate as a formula gets an apostrophe. For `staff` there is the column worker.
    """
    parameters = [parameter["name"] for parameter in exploration.space["parameters"]]
    worker = ("worker",) if staff else ()
    columns = (
        *(*(column.name for column in COLUMNS), *worker, *parameters, *OBJECTIVES, *STAGE_SECONDS),
        *(f"{name}@{sequence}" for sequence in _several_sequences(exploration) for name in SEQUENCE_COLUMNS),
    )
    writer = csv.DictWriter(_Line(), columns, extrasaction="ignore")
    yield writer.writeheader()
    for row in _rows(exploration, staff):
        yield writer.writerow({name: _cell(value) for name, value in row.items()})


def json_lines(exploration: Exploration, staff: bool = False) -> Iterator[str]:
    """A list with an object for each evaluation, with the names of the CSV columns."""
    before = "[\n"
    for row in _rows(exploration, staff):
        yield before + json.dumps(row)
        before = ",\n"
    yield "\n]\n" if before == ",\n" else "[]\n"


def _cell(value: Any) -> Any:
    return f"'{value}" if isinstance(value, str) and value.startswith(FORMULA_START) else value


def _rows(exploration: Exploration, staff: bool) -> Iterator[dict[str, Any]]:
    evaluations = exploration.evaluations.exclude(phase=Evaluation.Phase.PRIOR).order_by("number")
    for evaluation in evaluations.iterator(chunk_size=CHUNK):
        row = public_row(evaluation)
        hidden = {"phase": evaluation.phase, "error": evaluation.error, "worker": evaluation.worker}
        yield {
            **{column.name: _text(getattr(row, column.attribute)) for column in COLUMNS},
            **(hidden if staff else {}),
            **evaluation.configuration,
            **(evaluation.objectives or {}),
            **{f"{name}_seconds": seconds for name, seconds in (evaluation.stages or {}).items()},
            **{
                f"{name}@{part['sequence']}": part[name]
                for part in evaluation.parts or []
                for name in SEQUENCE_COLUMNS
            },
        }


def _text(value: Any) -> Any:
    return value.isoformat() if isinstance(value, datetime) else value


def _several_sequences(exploration: Exploration) -> list[str]:
    """The names of all sequences, held-out ones included; empty for a single sequence."""
    packs = [*exploration.learned_on, *exploration.held_out_sequences]
    return [pack["name"] for pack in packs] if len(packs) > 1 else []
