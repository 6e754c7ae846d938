"""Evaluations as everybody reads them."""

from collections.abc import Mapping
from typing import Any

from crowd.explorations.models import Evaluation
from crowd.records.evaluation import EvaluationRow, Part
from crowd.records.record import columns_of
from slam.isolated import NO_OBJECTIVES
from slam.public_text import without_folders


def public_row(evaluation: Evaluation) -> EvaluationRow:
    """`evaluation` without folders in its error, and without its phase until it is finished."""
    fields = {name: getattr(evaluation, name) for name in columns_of(Evaluation, EvaluationRow)}
    return EvaluationRow(
        **fields
        | {
            "phase": evaluation.public_phase,
            "error": without_folders(evaluation.error),
            "parts": None if evaluation.parts is None else [_part(part) for part in evaluation.parts],
            "device_name": (evaluation.device or {}).get("name"),
        }
    )


def _part(part: Mapping[str, Any]) -> Part:
    objectives = {name: value for name, value in part.items() if name not in NO_OBJECTIVES}
    return Part(part["sequence"], part["lost"], objectives, part.get("stopped_at"))
