"""Every evaluation of an exploration as CSV or JSON, line by line.

Everybody may read them, but for two things that only the staff sees: which process on which host measured,
and the folders that a reason names.
"""

import csv
import json
from collections.abc import Iterator
from typing import Any

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.objectives import MEASURED
from slam.isolated import STAGES
from slam.public_text import without_folders

ABOUT = (
    *("number", "phase", "iteration", "label", "state", "attempt", "frames", "perturbation", "censored"),
    *("software", "error"),
)
MOMENTS = ("started_at", "finished_at")
OBJECTIVES = (*MEASURED, "energy_joules")  # the last where a machine reports it
EACH_SEQUENCE = ("ate_max", "lost", "runtime")  # as ate_max@office, where there are several sequences
STAGE_SECONDS = tuple(f"{stage}_seconds" for stage in STAGES)
AT_ONCE = 500
FORMULA = ("=", "+", "-", "@", "\t", "\r")  # a spreadsheet computes a text that begins so


class _Line:
    """A file for csv that hands back each line instead of keeping it."""

    def write(self, line: str) -> str:
        return line


def csv_lines(exploration: Exploration, staff: bool = False) -> Iterator[str]:
    """A line for every evaluation: objectives in SI units, a column for each parameter and stage.

    Of an exploration over several sequences, also those held out, EACH_SEQUENCE has columns for each of them.
    A text that a spreadsheet would take for a formula begins with an apostrophe. For the STAFF there is one
    more column, the worker.
    """
    parameters = [parameter["name"] for parameter in exploration.space["parameters"]]
    worker = ("worker",) if staff else ()
    columns = (
        *(*ABOUT, *worker, "device", *MOMENTS, *parameters, *OBJECTIVES, *STAGE_SECONDS),
        *(f"{name}@{sequence}" for sequence in _several(exploration) for name in EACH_SEQUENCE),
    )
    writer = csv.DictWriter(_Line(), columns, extrasaction="ignore")
    yield writer.writeheader()
    for row in _rows(exploration, staff):
        yield writer.writerow({name: _cell(value) for name, value in row.items()})


def json_lines(exploration: Exploration, staff: bool = False) -> Iterator[str]:
    """A list with an object for every evaluation; the names are those of the CSV's columns."""
    before = "[\n"
    for row in _rows(exploration, staff):
        yield before + json.dumps(row)
        before = ",\n"
    yield "\n]\n" if before == ",\n" else "[]\n"


def _cell(value: Any) -> Any:
    return f"'{value}" if isinstance(value, str) and value.startswith(FORMULA) else value


def _rows(exploration: Exploration, staff: bool) -> Iterator[dict[str, Any]]:
    evaluations = exploration.evaluations.exclude(phase=Evaluation.Phase.PRIOR).order_by("number")
    for evaluation in evaluations.iterator(chunk_size=AT_ONCE):
        yield {
            **{name: getattr(evaluation, name) for name in ABOUT},
            **({"worker": evaluation.worker} if staff else {"error": without_folders(evaluation.error)}),
            "device": (evaluation.device or {}).get("name"),
            **{
                name: moment.isoformat() if (moment := getattr(evaluation, name)) else None
                for name in MOMENTS
            },
            **evaluation.configuration,
            **(evaluation.objectives or {}),
            **{f"{name}_seconds": seconds for name, seconds in (evaluation.stages or {}).items()},
            **{
                f"{name}@{part['sequence']}": part[name]
                for part in evaluation.parts or []
                for name in EACH_SEQUENCE
            },
        }


def _several(exploration: Exploration) -> list[str]:
    """The names of the exploration's sequences, also of those held out; none where there is one alone."""
    packs = [*exploration.learned_on, *exploration.held_out_sequences]
    return [pack["name"] for pack in packs] if len(packs) > 1 else []
