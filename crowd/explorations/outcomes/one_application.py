"""The evaluations of an exploration as one of its applications sees them."""

from collections.abc import Iterable
from copy import copy

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.searching.applications import SEVERAL, application_of, published_parameters
from crowd.explorations.searching.batches import configuration_digest


def evaluations_of(
    exploration: Exploration, application: str, evaluations: Iterable[Evaluation]
) -> list[Evaluation]:
    """Those of `evaluations` that `application` ran, with the parameters that it has.

    Configurations that differ only in other parameters, such as options of a build, become one. The copies
    are for reading: they must not be saved.
    """
    return [
        _reduced(exploration, evaluation, application)
        for evaluation in evaluations
        if application_of(exploration, evaluation.configuration) == application
    ]


def _reduced(exploration: Exploration, evaluation: Evaluation, application: str) -> Evaluation:
    configuration = published_parameters(exploration, evaluation.configuration)
    if configuration == evaluation.configuration:
        return evaluation
    reduced = copy(evaluation)
    reduced.configuration, reduced.configuration_key = configuration, configuration_digest(configuration)
    if exploration.application == SEVERAL:
        reduced.label = evaluation.label.removeprefix(f"{application}-")
    return reduced
