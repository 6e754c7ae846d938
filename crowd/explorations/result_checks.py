"""Checks of what a machine sends for an evaluation that it leased; each raises Problem 400."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from django.conf import settings

from crowd.explorations.measuring import measurement, work_bound
from crowd.explorations.measuring.measurement import CannotMeasureHereError, Measurement
from crowd.explorations.models import Evaluation
from crowd.explorations.objectives import without_ratios
from crowd.fronts import intake_policy
from crowd.http.problems import Problem
from groundwork import __version__
from pareto.fronts.objective import Objective
from pareto.search.stopping import find_stop
from slam.stopping import ERROR, TIME, find_broken, least_time
from slam.system import STAGES
from wire.evaluation import Part
from wire.lease import Result
from wire.protocol import FIRST_STOP, RUNTIMES, SHORTEST_FRAME_US, STAGE_SLACK_US, STAGE_TOLERANCE

MICROSECONDS = 1e6  # a second
REQUIRED_OBJECTIVES = ("runtime", "ate_max")  # by all pages, for any objectives


def check_program(evaluation: Evaluation, result: Result) -> None:
    """Check the `result` of a program."""
    values = result.values or {}
    if missing := [name for name in evaluation.exploration.objectives if name not in values]:
        raise Problem("invalid_field", f"values lack {', '.join(missing)}", field="values")
    _check_early_end(evaluation, values, result.censored, result.stopped_at)


def check_system(evaluation: Evaluation, result: Result, measured: Measurement) -> None:
    """Check the `result` of a SLAM system, `measured`: as a whole, and over each sequence."""
    parts = result.parts or []
    _require(evaluation, measured.objectives, "objectives")
    _check_parts(evaluation, parts)
    _check_software(result.software)
    _check_stages(measured.objectives["runtime"], measured.stages)
    side = _largest_volume(evaluation)
    for values in (measured.objectives, *(part.objectives for part in parts)):
        _check_possible(values, side)
    if too_fast := work_bound.beyond_work(evaluation, measured):
        raise Problem("invalid_field", too_fast, field="objectives")


def _check_early_end(
    evaluation: Evaluation, values: Mapping[str, float], censored: Sequence[str], stopped_at: int | None
) -> None:
    """Raise Problem 400 unless a program that ended early broke one of the conditions of `evaluation`."""
    exploration = evaluation.exploration
    if unknown := [name for name in censored if name not in exploration.objectives]:
        raise Problem(
            "invalid_field",
            f"censored names {unknown[0]}, which is not an objective: name some of "
            f"{', '.join(exploration.objectives)}",
            field="censored",
        )
    if stopped_at is None:
        if censored:
            raise Problem(
                "invalid_field",
                f"censored names {', '.join(censored)}: also send stopped_at, the number of reports "
                "after which the program was ended",
                field="stopped_at",
            )
        return
    maximised = exploration.options["maximised"]
    objectives = [Objective(name, name in maximised) for name in exploration.objectives]
    bounds = {name: values[name] for name in exploration.objectives if name in censored}
    estimates = {name: values[name] for name in exploration.objectives if name not in censored}
    if find_stop(objectives, evaluation.stop_above, bounds, estimates) is None:
        raise Problem(
            "invalid_field",
            f"the program ended after {stopped_at} reports: let it run until a condition of "
            "stop_above is broken",
            field="stopped_at",
        )


def _check_software(software: str) -> None:
    """Raise Problem 400 unless `software` names a version that this server takes, such as client_kit
    1.0.0."""
    wanted = intake_policy.current()
    if not wanted.takes(software.rpartition(" ")[2]):
        raise Problem(
            "invalid_field",
            f"software is {software!r}: give a version from {wanted.minimum_app_version} to {__version__}",
            field="software",
        )


def _check_stages(runtime: float, stages: Mapping[str, float]) -> None:
    """Raise Problem 400 if `stages` take longer than the frame (`runtime`, s), by more than clocks differ."""
    total = sum(stages.get(stage, 0.0) for stage in STAGES)  # reading the images is not part of a frame
    if total > STAGE_TOLERANCE * runtime + STAGE_SLACK_US / MICROSECONDS:
        raise Problem(
            "invalid_field",
            f"the stages take {total:g} s a frame, more than the whole frame ({runtime:g} s)",
            field="stages",
        )


def _check_possible(objectives: Mapping[str, float], side: float) -> None:
    """Raise Problem 400 if no device can measure `objectives` in a volume of `side` (m)."""
    runtime, shortest = objectives["runtime"], SHORTEST_FRAME_US / MICROSECONDS
    longest = settings.FRONTRUNNER_MEASUREMENT_TIMEOUT_SECONDS
    if not shortest <= runtime <= longest:
        raise Problem(
            "invalid_field",
            f"runtime is {runtime:g} s a frame: give {shortest:g} to {longest:g}",
            field="objectives",
        )
    largest = objectives.get("runtime_max", math.inf)
    for name in RUNTIMES:
        if objectives.get(name, 0.0) > largest:
            raise Problem(
                "invalid_field",
                f"{name} is {objectives[name]:g} s, longer than the longest frame, runtime_max {largest:g}",
                field="objectives",
            )
    for name, value in objectives.items():
        if name.startswith("ate_") and value > side:
            raise Problem(
                "invalid_field",
                f"{name} is {value:g} m, beyond the volume of {side:g} m: send a lost camera as failed",
                field="objectives",
            )


def _largest_volume(evaluation: Evaluation) -> float:
    """The side (m) of the largest volume of `evaluation`'s sequences; infinite once they are gone."""
    try:
        return max(float(pack["volume_size"]) for _, pack in measurement.packs_for(evaluation))
    except CannotMeasureHereError:
        return math.inf


def _require(evaluation: Evaluation, objectives: Mapping[str, Any], field: str, of: str = "") -> None:
    """Raise Problem 400 if `objectives` lack what pages or the exploration of `evaluation` need."""
    wanted = without_ratios(dict.fromkeys((*REQUIRED_OBJECTIVES, *evaluation.exploration.objectives)))
    if missing := [name for name in wanted if name not in objectives]:
        raise Problem("invalid_field", f"objectives{of} lack {', '.join(missing)}", field=field)


def _check_parts(evaluation: Evaluation, parts: Sequence[Part]) -> None:
    """Raise Problem 400 if `parts` do not match the sequences of `evaluation`'s lease."""
    wanted = [pack["name"] for pack in measurement.sequence_names(evaluation)]
    measured = [part.sequence for part in parts]
    for name in measured:
        if name not in wanted or measured.count(name) > 1:
            raise Problem(
                "invalid_field",
                f"parts name {name}, {'twice' if name in wanted else 'which the lease does not'}: send one "
                f"part for each of {', '.join(wanted)}",
                field="parts",
            )
    for part in parts:
        _require(evaluation, part.objectives, "parts", f" of {part.sequence}")
        stopped = part.stopped_at
        if stopped is not None and (stopped < FIRST_STOP or not _above(evaluation, part)):
            raise Problem(
                "invalid_field",
                f"{part.sequence} ended after {stopped} frames: run at least {FIRST_STOP}, and on until a "
                "condition of stop_above is broken",
                field="parts",
            )
    missing = [name for name in wanted if name not in measured]
    if missing and not _stopped(evaluation, parts):
        raise Problem(
            "invalid_field",
            f"parts lack {', '.join(missing)}: measure every sequence of the lease until stop_after is "
            "reached",
            field="parts",
        )


def _stopped(evaluation: Evaluation, parts: Iterable[Part]) -> bool:
    """Whether enough of `parts` break a condition to stop before the last sequence."""
    above = [part for part in parts if _above(evaluation, part)]
    return len(above) >= measurement.stop_after(evaluation)


def _above(evaluation: Evaluation, part: Part) -> bool:
    """Whether `part` is certain to be above one of the conditions of `evaluation`."""
    certain = {ERROR: part.objectives[ERROR], TIME: least_time(part.objectives[TIME])}
    return find_broken(evaluation.stop_above, certain) is not None
