"""New evaluations of an exploration: numbered on, each with its configuration's digest and place."""

import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from django.db.models import Max

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.searching import baseline_configurations, ratios, search
from crowd.explorations.searching.baseline_configurations import DEFAULT

Wanted = tuple[Mapping[str, Any], str, str]  # configuration, phase, label


def add(exploration: Exploration, wanted: Sequence[Wanted], iteration: int | None = None) -> list[Evaluation]:
    """Store new evaluations, numbered on; repeats run over whole sequences.

    The first repeat of a configuration sees depth as it is, each further one depth that is perturbed
    otherwise: an error that rounding decides shows in them.

    Without ITERATION it is the one after the last.
    """
    space = search.space_of(exploration)
    if iteration is None:
        last = exploration.evaluations.aggregate(last=Max("iteration"))["last"]
        iteration = 1 + (last or 0)
    first = exploration.evaluations.count()
    repeats: Counter[str] = Counter()
    if any(phase == Evaluation.Phase.REPEAT for _, phase, _ in wanted):
        earlier = exploration.evaluations.filter(phase=Evaluation.Phase.REPEAT)
        repeats.update(earlier.values_list("configuration_key", flat=True))

    def perturbation(configuration: Mapping[str, Any], phase: str) -> int:
        if phase != Evaluation.Phase.REPEAT:
            return 0
        repeats[key(configuration)] += 1
        return repeats[key(configuration)] - 1

    return Evaluation.objects.bulk_create(
        Evaluation(
            exploration=exploration,
            number=first + place,
            phase=phase,
            label=label,
            configuration=configuration,
            configuration_key=key(configuration),
            index=search.place_of(space, configuration),
            iteration=iteration,
            frames=None if phase == Evaluation.Phase.REPEAT else exploration.frames,
            perturbation=perturbation(configuration, phase),
        )
        for place, (configuration, phase, label) in enumerate(wanted)
    )


def rounds(
    missing: Iterable[tuple[Mapping[str, Any], str, int]], default: Mapping[str, Any] | None = None
) -> list[Wanted]:
    """Each (configuration, label, times) as often as it says, in turn with the others.

    Round after round, so that a slow drift of the machine affects all alike. DEFAULT, where it is given,
    begins each round, even where it is not missing.
    """
    missing = list(missing)
    found: list[Wanted] = []
    for number in range(max((times for _, _, times in missing), default=0)):
        others = [(configuration, label) for configuration, label, times in missing if number < times]
        if default is not None:
            others = [(default, DEFAULT), *(row for row in others if row[0] != default)]
        found += [(configuration, Evaluation.Phase.REPEAT, label) for configuration, label in others]
    return found


def with_default(exploration: Exploration, wanted: Sequence[Wanted]) -> list[Wanted]:
    """WANTED as a round that begins with the default, where EXPLORATION minimises the runtime's ratio.

    Repeats have the default in their rounds already.
    """
    repeats = {phase for _, phase, _ in wanted} <= {Evaluation.Phase.REPEAT}
    default = default_of(exploration)
    if default is None or repeats:
        return list(wanted)
    return [(default, Evaluation.Phase.DEFAULT, DEFAULT), *wanted]


def default_of(exploration: Exploration) -> dict[str, Any] | None:
    """The default that each round is compared with; None where the exploration does not compare so."""
    if not ratios.used(exploration):
        return None
    space = search.space_of(exploration)
    return baseline_configurations.configurations(exploration.application, space)[DEFAULT]


def key(configuration: Mapping[str, Any]) -> str:
    """A digest by which measurements of one configuration find each other."""
    return hashlib.sha256(json.dumps(configuration, sort_keys=True).encode()).hexdigest()
