"""The speedup over the default that the work in the plans allows: a faster answer was not measured.

A row and the default are compared by whichever of them comes second.
"""

import math
from collections.abc import Mapping
from copy import copy
from typing import Any

from crowd.explorations.measuring import measurement
from crowd.explorations.measuring.measurement import Measurement
from crowd.explorations.models import Evaluation
from crowd.explorations.searching.baseline_configurations import DEFAULT
from crowd.explorations.searching.ratios import COPIED
from crowd.fronts.content import plans
from slam.kfusion.work import REFERENCE_MARGIN, widened, with_other, work_range
from slam.system import STAGES


def beyond_work(evaluation: Evaluation, measured: Measurement) -> str:
    """What is too fast if `measured` is the result of `evaluation`; empty for nothing.

    The default is compared with what was measured in its round, all others with the newest default over as
    many frames. Nothing is compared without a plan. One query.
    """
    if not plans.has_plans(evaluation.exploration.application):
        return ""
    new = copy(evaluation)
    new.stages = dict(measured.stages)
    for column, value in measurement.result_columns(evaluation, measured).items():
        setattr(new, column, value)
    rows = evaluation.exploration.evaluations.filter(
        state=Evaluation.State.DONE, frames=evaluation.frames
    ).exclude(phase__in=COPIED)
    if evaluation.label == DEFAULT:
        others = rows.filter(iteration=evaluation.iteration).exclude(label=DEFAULT)
        return next(filter(None, (_too_fast(new, other) for other in others)), "")
    default = rows.filter(label=DEFAULT).order_by("-number").first()
    return "" if default is None else _too_fast(default, new)


def _too_fast(default: Evaluation, other: Evaluation) -> str:
    before, now = _runtimes(default), _runtimes(other)
    for pack in measurement.sequence_names(other):
        name = pack["name"]
        ratios = plans.stage_ratios_on(
            pack["sha256"], default.configuration, other.configuration, other.frames
        )
        if ratios is None or name not in before or name not in now:
            continue
        _, most = map(math.exp, work_range(ratios, _shares(default)))
        if (speedup := before[name] / now[name]) > most:
            return (
                f"{other} is {speedup:.3g} times as fast as the default on {name}: its work allows {most:.3g}"
            )
    return ""


def _runtimes(row: Evaluation) -> dict[str, float]:
    """Seconds a frame by sequence. Only several sequences have parts."""
    objectives: Mapping[str, Any] = row.objectives or {}
    parts = row.parts or [{"sequence": row.exploration.sequence, **objectives}]
    return {part["sequence"]: part["runtime"] for part in parts}


def _shares(default: Evaluation) -> Mapping[str, tuple[float, float]]:
    """How large a part of the default's frame each stage may be."""
    runtime = (default.objectives or {})["runtime"]
    stages = {stage: (default.stages or {}).get(stage, 0.0) / runtime for stage in STAGES}
    return widened(with_other(stages), REFERENCE_MARGIN) if any(stages.values()) else {}
