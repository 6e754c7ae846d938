"""Measures one evaluation on this machine, with slam or the function in FRONTRUNNER_EVALUATOR."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from django.conf import settings
from django.utils.module_loading import import_string

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.objectives import ERROR_RATIO, without_ratios
from crowd.explorations.searching import ratios
from crowd.explorations.searching.applications import application_of, applications, measured_parameters
from crowd.fronts import sequences
from crowd.fronts.content import plans
from crowd.fronts.content.front_file import needs_colour
from slam import isolated
from slam.isolated import CannotMeasureHereError, LeaseLostError, Measurement, MeasurementError

DECODED = "decoded"  # the folder of decoded depth, which all evaluations share; it may be deleted
Heartbeat = Callable[[], bool]
Evaluator = Callable[[Evaluation, Heartbeat | None], Measurement]

__all__ = [
    "CannotMeasureHereError",
    "LeaseLostError",
    "Measurement",
    "MeasurementError",
    "evaluator",
    "find_packs",
    "measure",
    "packs_for",
    "result_columns",
    "sequence_names",
    "stop_after",
]


def evaluator() -> Evaluator:
    """The function in FRONTRUNNER_EVALUATOR: `measure` by default."""
    return _import_evaluator(settings.FRONTRUNNER_EVALUATOR)


@cache
def _import_evaluator(path: str) -> Evaluator:
    evaluate: Evaluator = import_string(path)
    return evaluate


def measure(evaluation: Evaluation, heartbeat: Heartbeat | None = None) -> Measurement:
    """Measure `evaluation`'s configuration in a fresh process; `heartbeat` and errors as in `slam.isolated`.

    Also raises CannotMeasureHereError if a sequence is not on this machine.
    """
    exploration = evaluation.exploration
    if evaluation.phase == Evaluation.Phase.REFERENCE:
        return _measure_reference(evaluation, heartbeat)
    return isolated.measure(
        application_of(exploration, evaluation.configuration),
        measured_parameters(exploration, evaluation.configuration),
        [path for path, _ in packs_for(evaluation)],
        perturbation=evaluation.perturbation or None,
        stop_above=evaluation.stop_above,
        stop_after=stop_after(evaluation),
        learned_on=len(exploration.learned_on),
        decoded=Path(settings.FRONTRUNNER_VAR) / DECODED,
        device=exploration.reference_device.opencl_device,
        backend=exploration.reference_device.backend,
        frames=evaluation.frames,
        heartbeat=heartbeat,
        heartbeat_seconds=settings.FRONTRUNNER_HEARTBEAT_SECONDS,
        timeout=settings.FRONTRUNNER_MEASUREMENT_TIMEOUT_SECONDS,
    )


def _measure_reference(evaluation: Evaluation, heartbeat: Heartbeat | None) -> Measurement:
    """As `measure`, on every device here; `reference` also has the digest of the `program`."""
    exploration = evaluation.exploration
    [(path, pack)] = packs_for(evaluation)
    measured = isolated.measure_reference(
        exploration.application,
        evaluation.configuration,
        path,
        frames=evaluation.frames,
        heartbeat=heartbeat,
        heartbeat_seconds=settings.FRONTRUNNER_HEARTBEAT_SECONDS,
        timeout=settings.FRONTRUNNER_MEASUREMENT_TIMEOUT_SECONDS,
    )
    program = plans.program_digest(exploration.application, pack["sha256"], evaluation.configuration)
    return replace(measured, reference=(measured.reference or {}) | {"program": program})


def sequence_names(evaluation: Evaluation) -> list[dict[str, str]]:
    """Name and digest of the packs that `evaluation` runs over. Repeats include held-out ones."""
    exploration = evaluation.exploration
    held_out = exploration.held_out_sequences if evaluation.phase == Evaluation.Phase.REPEAT else []
    return [*exploration.learned_on, *held_out]


def packs_for(evaluation: Evaluation) -> list[tuple[Path, dict[str, Any]]]:
    """The folders of these packs and their descriptions. Raises CannotMeasureHereError as `find_packs`."""
    return find_packs(evaluation.exploration, sequence_names(evaluation))


def stop_after(evaluation: Evaluation) -> int:
    """The number of sequences that break one of its `stop_above` after which `evaluation` ends."""
    return evaluation.exploration.failures_allowed + 1


def result_columns(evaluation: Evaluation, measurement: Measurement) -> dict[str, Any]:
    """The columns of `evaluation` for `measurement`: objectives over the sequences learned on, parts,
    censored.

    `censored`: the objectives that are bounds, since a sequence ended early or was not run. Parts of a single
    sequence are only stored where it ended early, and for their lost frames: of repeats, and where they are
    compared with the default's. `reference`: of a front's point. A program's only part says where it ended.
    """
    exploration = evaluation.exploration
    if exploration.measures_program:
        bounds = [name for part in measurement.parts for name in part["censored"]]
        return {
            "objectives": measurement.objectives,
            "parts": list(measurement.parts) or None,
            "censored": bounds,
        }
    if measurement.reference is not None:
        return {"objectives": without_ratios(measurement.objectives), "reference": measurement.reference}
    names = [pack["name"] for pack in exploration.learned_on]
    learned = [part for part in measurement.parts if part["sequence"] in names]
    repeated = evaluation.phase == Evaluation.Phase.REPEAT
    stopped = any(part.get("stopped_at") is not None for part in learned)
    once = len(names) == 1 and not repeated and not ratios.uses_ratio(exploration) and not stopped
    if once or not learned:
        return {"objectives": without_ratios(measurement.objectives)}
    allowed = exploration.failures_allowed
    censored = isolated.bounds(learned, len(names), allowed)
    if "ate_max" in censored and ratios.uses_ratio(exploration):
        censored.append(ERROR_RATIO)
    return {
        "objectives": without_ratios(isolated.combine(learned, allowed)),
        "parts": list(measurement.parts),
        "censored": censored,
    }


def find_packs(
    exploration: Exploration, names: Iterable[Mapping[str, str]]
) -> list[tuple[Path, dict[str, Any]]]:
    """The folder and description of each pack in `names`, with colour if an application needs it.

    Raises CannotMeasureHereError if this machine lacks a pack with that name and digest, or its colour.
    """
    colour = any(map(needs_colour, applications(exploration)))
    names = list(names)
    here: dict[tuple[str, str], Path] = {}
    for pack in sequences.packs():
        description = sequences.read_description(pack)
        here.setdefault((description["name"], description["sha256"]), pack)
        if all((wanted["name"], wanted["sha256"]) in here for wanted in names):
            break
    packs = []
    for wanted in names:
        path = here.get((wanted["name"], wanted["sha256"]))
        if path is None:
            raise CannotMeasureHereError(
                f"no pack {wanted['name']} with digest {wanted['sha256'][:12]}... on this machine: put it "
                "into one of the sequence folders (`python -m slam datasets make all` makes those of the "
                "synthetic scenes)"
            )
        try:
            packs.append((path, sequences.read_description(path, colour)))
        except sequences.SequenceError as error:
            raise CannotMeasureHereError(str(error)) from error
    return packs
