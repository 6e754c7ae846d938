"""Algorithm 1 over a design space, kept as the rows of one file."""

from __future__ import annotations

import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from frontrunner.paper.budget import DEFAULT, SEQUENCE, Study
from groundwork import terminal
from pareto.measuring.folder import EVALUATIONS, Folder
from pareto.measuring.progress import Progress
from pareto.search.explorer import Explorer
from pareto.spaces.space import Configuration
from slam import isolated
from wire.protocol import VALID_BELOW

# The first is the horizontal axis of the paper's figure.
ERROR, RUNTIME = "ate_max", "runtime"
OBJECTIVES = (ERROR, RUNTIME)

Measure = Callable[[Configuration], dict[str, float]]
Rows = dict[int, list[tuple[dict[str, float] | None, str]]]  # values and phase, by index
References = dict[str, dict[str, float]]  # medians by label, of those that succeeded


@dataclass(frozen=True)
class Exploration:
    """A search as far as it was measured, and the front that it predicts.

    `iterations` of active learning are measured. `ended`: the whole predicted front was measured, so
    Algorithm 1 ended by itself. `refits` are the seconds that forests and predictions of the space took.
    """

    study: Study
    explorer: Explorer
    predicted: tuple[tuple[Configuration, dict[str, float]], ...]
    iterations: int
    ended: bool
    refits: tuple[float, ...]


def measured_whole(study: Study) -> Measure:
    """A function that runs a configuration over the sequence, in a process of its own.

    It raises MeasurementError for a configuration without a result.
    """

    def measure(configuration: Configuration) -> dict[str, float]:
        measurement = isolated.measure(study.system, configuration, [SEQUENCE], frames=study.frames)
        return {name: measurement.objectives[name] for name in OBJECTIVES}

    return measure


def fresh(study: Study) -> Explorer:
    """Algorithm 1 before its first sample."""
    options: dict[str, Any] = {"initial": study.random} | ({"batch": study.batch} if study.batch else {})
    return Explorer(study.space(), OBJECTIVES, {ERROR: VALID_BELOW}, method="algorithm1", **options)


def explore(study: Study, path: Path, measure: Measure) -> Exploration:
    """Search until the budget is spent or Algorithm 1 ends.

    Algorithm 1 draws from its seed and learns from its results alone, so it is run again from the start each
    time: what it asks for is looked up in the rows of `evaluations.csv`, and measured once they end. Rows
    that it does not ask for are another budget's or another machine's. They count as measured, too.
    """
    folder, explorer = Folder(path), fresh(study)
    rows: Rows = defaultdict(list)
    for configuration, values, phase in folder.measurements(explorer):
        rows[explorer.space.encode(configuration)].append((values, phase))
    refits: list[float] = []
    ended = False
    for iteration in count():  # 0 is that of the random samples
        if study.iterations is not None and iteration > study.iterations:
            break
        began = time.monotonic()
        proposals = explorer.propose(len(explorer.space))
        if iteration:
            refits.append(time.monotonic() - began)
        ended = not proposals
        if ended:
            break
        _tell(explorer, rows, [proposal.index for proposal in proposals])
        if rows and explorer.history.pending:
            terminal.warn(
                f"{path / EVALUATIONS} has {len(rows)} configurations that Algorithm 1 does not ask for: "
                "another budget or another machine chose them; it learns from them, too"
            )
            _tell(explorer, rows, list(rows))
        missing = explorer.pending()
        done = len(explorer.history.results)
        progress = Progress(explorer, done + len(missing), sys.stderr)
        for number, configuration in enumerate(missing, start=done + 1):
            record(explorer, folder, configuration, measure)
            progress.update(number)
        progress.end()
        folder.asked(explorer)
    predicted = tuple(explorer.predicted_front())
    return Exploration(study, explorer, predicted, len(refits) - ended, ended, tuple(refits))


def measure_references(study: Study, path: Path, measure: Measure, times: int) -> References:
    """Measure the default and the other references until each has `times` measurements, in turn.

    Raises MeasurementError where the default cannot be measured: no other configuration can be, then.
    """
    folder, explorer = Folder(path), Explorer(study.space(), OBJECTIVES, method="random")
    for configuration, values, phase in folder.measurements(explorer):
        explorer.tell([configuration], [values], phase)

    def successes(configuration: Mapping[str, Any]) -> list[tuple[float, ...]]:
        values = explorer.history.results.get(explorer.space.encode(configuration), [])
        return [each for each in values if each is not None]

    for number in range(times):
        for label, reference in study.configurations().items():
            if len(successes(reference)) <= number:
                failure = record(explorer, folder, dict(reference), measure, label)
                if failure and label == DEFAULT:
                    raise isolated.MeasurementError(
                        f"the default of {study.system} cannot be measured: {failure}"
                    )
    folder.asked(explorer)
    return {
        label: dict(zip(OBJECTIVES, np.median(measured, axis=0).tolist(), strict=True))
        for label, reference in study.configurations().items()
        if (measured := successes(reference))
    }


def record(
    explorer: Explorer, folder: Folder, configuration: Configuration, measure: Measure, phase: str = ""
) -> str:
    """Measure a configuration and store the row; return why it failed, or nothing."""
    began = time.monotonic()
    values, failure = None, ""
    try:
        values = measure(configuration)
    except isolated.MeasurementError as error:
        failure = str(error)
    explorer.tell([configuration], [values], phase)
    folder.append(explorer, configuration, values, time.monotonic() - began, failure)
    return failure


def _tell(explorer: Explorer, rows: Rows, indices: Iterable[int]) -> None:
    """Tell the explorer the rows of `indices`, in this order, and remove them."""
    for index in indices:
        for values, phase in rows.pop(index, ()):
            explorer.tell([explorer.space.decode(index)], [values], phase)
