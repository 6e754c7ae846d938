"""Evaluations as everybody reads them."""

from crowd.explorations.models import Evaluation
from crowd.records.evaluation import EvaluationRow, Part
from crowd.records.record import columns_of
from slam.public_text import without_folders


def public_row(evaluation: Evaluation) -> EvaluationRow:
    """`evaluation` without folders in its error, and without its phase until it is finished."""
    fields = {name: getattr(evaluation, name) for name in columns_of(Evaluation, EvaluationRow)}
    return EvaluationRow(
        **fields
        | {
            "phase": evaluation.public_phase,
            "error": without_folders(evaluation.error),
            "parts": None if evaluation.parts is None else list(map(Part.of, evaluation.parts)),
            "device_name": (evaluation.device or {}).get("name"),
        }
    )
