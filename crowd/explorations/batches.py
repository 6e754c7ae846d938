"""New evaluations of an exploration: numbered on, each with its configuration's digest and place."""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from django.db.models import Max

from crowd.explorations import search
from crowd.explorations.models import Evaluation, Exploration

Wanted = tuple[Mapping[str, Any], str, str]  # configuration, phase, label


def add(exploration: Exploration, wanted: Sequence[Wanted], iteration: int | None = None) -> list[Evaluation]:
    """Store new evaluations, numbered on; repeats run over the whole sequence.

    Without ITERATION it is the one after the last.
    """
    space = search.space_of(exploration)
    if iteration is None:
        last = exploration.evaluations.aggregate(last=Max("iteration"))["last"]
        iteration = 1 + (last or 0)
    first = exploration.evaluations.count()
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
        )
        for place, (configuration, phase, label) in enumerate(wanted)
    )


def rounds(missing: Iterable[tuple[Mapping[str, Any], str, int]]) -> list[Wanted]:
    """Each (configuration, label, times) as often as it says, in turn with the others.

    Round after round, so that a slow drift of the machine meets every one alike.
    """
    missing = list(missing)
    return [
        (configuration, Evaluation.Phase.REPEAT, label)
        for number in range(max((times for _, _, times in missing), default=0))
        for configuration, label, times in missing
        if number < times
    ]


def key(configuration: Mapping[str, Any]) -> str:
    """A digest by which measurements of one configuration find each other."""
    return hashlib.sha256(json.dumps(configuration, sort_keys=True).encode()).hexdigest()
