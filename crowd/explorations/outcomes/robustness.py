"""Robustness of a configuration from its repeats: its worst results, and whether it is on an edge.

The first repeat uses the recorded depth, each further one depth that is changed by one unit. If that decides
the error, the rounding of another driver may decide it, too.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from crowd.explorations.models import Evaluation, Exploration
from crowd.fronts.content.generalisation import Results, bound
from wire.front import SequenceResult


@dataclass(frozen=True)
class Robustness:
    """`results`: the largest error and the most lost frames on each sequence.

    `edge`: the sequences on which a slight change of depth decides the error; empty without any.
    """

    results: Results
    edge: str


def repeat_robustness(exploration: Exploration, evaluations: Iterable[Evaluation]) -> dict[str, Robustness]:
    """The robustness of each repeated configuration by key."""
    groups: dict[str, list[Evaluation]] = {}
    for row in evaluations:
        if row.phase == Evaluation.Phase.REPEAT and row.state == Evaluation.State.DONE and row.parts:
            groups.setdefault(row.configuration_key, []).append(row)
    return {key: _robustness(exploration, rows) for key, rows in groups.items()}


def _robustness(exploration: Exploration, rows: Sequence[Evaluation]) -> Robustness:
    runs: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        for part in row.parts or []:
            runs.setdefault(part["sequence"], []).append(part)
    edges = [name for name, parts in runs.items() if _is_on_edge(parts)]
    return Robustness(
        results=Results(
            _results(exploration.learned_on, runs), _results(exploration.held_out_sequences, runs)
        ),
        edge=", ".join(edges),
    )


def _is_on_edge(parts: Sequence[Mapping[str, Any]]) -> bool:
    errors = [float(part["ate_max"]) for part in parts]
    lost = [int(part["lost"]) for part in parts]
    return max(errors) > bound(min(errors)) or max(lost) > 0 == min(lost)


def _results(
    packs: Iterable[Mapping[str, str]], runs: Mapping[str, Sequence[Mapping[str, Any]]]
) -> tuple[SequenceResult, ...]:
    return tuple(
        SequenceResult(
            sequence=pack["name"],
            ate_max=max(part["ate_max"] for part in runs[pack["name"]]),
            lost=max(part["lost"] for part in runs[pack["name"]]),
        )
        for pack in packs
        if pack["name"] in runs
    )
