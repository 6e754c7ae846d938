"""Evaluations as everybody reads them."""

import sys
from typing import Any

from crowd.explorations.models import Evaluation
from slam.public_text import without_folders
from wire.evaluation import EvaluationRow, Part


def fields(evaluation: Evaluation) -> dict[str, Any]:
    """Those of `evaluation`, without folders in its error, and without its phase until it is finished."""
    return {name: getattr(evaluation, name) for name in EvaluationRow.__struct_fields__} | {
        "phase": evaluation.public_phase,
        "state": sys.intern(evaluation.state),  # msgspec omits a default that is the same object
        "error": without_folders(evaluation.error),
        "parts": None if evaluation.parts is None else list(map(Part.of, evaluation.parts)),
    }


def public_row(evaluation: Evaluation) -> EvaluationRow:
    """`evaluation` as the API and the exports have it."""
    return EvaluationRow(**fields(evaluation))
