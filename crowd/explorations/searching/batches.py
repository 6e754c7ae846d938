"""Adds evaluations to an exploration, with their numbers, digests and indices."""

import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from django.db.models import Max
from django.utils.crypto import salted_hmac

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.searching import baseline_configurations, ratios, search
from crowd.explorations.searching.baseline_configurations import DEFAULT, is_default
from pareto.search.history import History
from slam.definitions import without_optional

MEASURED_AGAIN = 20
MAY_STOP = (Evaluation.Phase.GIVEN, *search.CHOSEN_ONCE)
WantedEvaluation = tuple[Mapping[str, Any], str, str]  # configuration, phase, label


def add_evaluations(
    exploration: Exploration,
    wanted: Sequence[WantedEvaluation],
    iteration: int | None = None,
    history: History | None = None,
) -> list[Evaluation]:
    """Store `wanted` as new evaluations with the next numbers. Repeats run over whole sequences.

    The first repeat of a configuration uses the recorded depth, each further one a different perturbation, to
    reveal errors that depend on rounding. `iteration`: default is the one after the last.

    Measurements of MAY_STOP may end early, by the limits and by the finished points of `history`. The default
    runs to its end: others are compared with it.
    """
    space = search.search_space(exploration)
    history = history or search.new_explorer(exploration).history
    conditions = search.stop_conditions(exploration, history)
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
        repeats[configuration_digest(configuration)] += 1
        return repeats[configuration_digest(configuration)] - 1

    return Evaluation.objects.bulk_create(
        Evaluation(
            exploration=exploration,
            number=first + offset,
            phase=phase,
            label=label,
            configuration=configuration,
            configuration_key=configuration_digest(configuration),
            index=search.space_index(space, configuration),
            iteration=iteration,
            frames=None if phase == Evaluation.Phase.REPEAT else exploration.frames,
            perturbation=perturbation(configuration, phase),
            stop_above=conditions if phase in MAY_STOP and not is_default(label) else [],
        )
        for offset, (configuration, phase, label) in enumerate(wanted)
    )


def repeat_rounds(
    missing: Iterable[tuple[Mapping[str, Any], str, int]], default: Mapping[str, Any] | None = None
) -> list[WantedEvaluation]:
    """Repeats of each (configuration, label, times), in rounds, so that a slow drift affects all equally.

    `default`, if given, starts each round.
    """
    missing = list(missing)
    repeats: list[WantedEvaluation] = []
    for number in range(max((times for _, _, times in missing), default=0)):
        others = [(configuration, label) for configuration, label, times in missing if number < times]
        if default is not None:
            others = [(default, DEFAULT), *(row for row in others if row[0] != default)]
        repeats += [(configuration, Evaluation.Phase.REPEAT, label) for configuration, label in others]
    return repeats


def with_default(exploration: Exploration, wanted: Sequence[WantedEvaluation]) -> list[WantedEvaluation]:
    """`wanted` with the default in front, if `exploration` minimises a ratio. Repeats already contain it."""
    repeats = {phase for _, phase, _ in wanted} <= {Evaluation.Phase.REPEAT}
    default = round_default(exploration)
    if default is None or repeats:
        return list(wanted)
    return [(default, Evaluation.Phase.DEFAULT, DEFAULT), *wanted]


def measured_again(exploration: Exploration, evaluations: Sequence[Evaluation]) -> list[WantedEvaluation]:
    """One in MEASURED_AGAIN of the finished `evaluations`, once more, if the device answers over HTTP.

    A keyed hash chooses: the device cannot know which.
    """
    if not exploration.reference_device.token_sha256:
        return []
    checked = {row.index for row in evaluations if row.phase == Evaluation.Phase.CHECK}
    chosen = [
        row.pk
        for row in evaluations
        if row.phase in search.CHOSEN_ONCE
        and row.state == Evaluation.State.DONE
        and row.index not in checked
        and not row.censored
        and int(salted_hmac("measured again", str(row.pk)).hexdigest()[:8], 16) % MEASURED_AGAIN == 0
    ]
    chosen_rows = exploration.evaluations.filter(pk__in=chosen).order_by("number")
    return [(row.configuration, Evaluation.Phase.CHECK, row.label) for row in chosen_rows]


def round_default(exploration: Exploration) -> dict[str, Any] | None:
    """The default configuration, if each round needs it for ratios; else None."""
    if not ratios.uses_ratio(exploration):
        return None
    space = search.search_space(exploration)
    return baseline_configurations.baseline_configurations(exploration.application, space)[DEFAULT]


def configuration_digest(configuration: Mapping[str, Any]) -> str:
    """A digest of `configuration`, which identifies its measurements. Parameters that change nothing do not
    count.
    """
    described = json.dumps(without_optional(configuration), sort_keys=True)
    return hashlib.sha256(described.encode()).hexdigest()
