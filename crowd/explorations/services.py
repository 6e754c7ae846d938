"""Writes of explorations: create, steer, advance. Messages are only hints; rows are the truth."""

import logging
from collections.abc import Mapping, Sequence
from typing import Any

from django.core.exceptions import ValidationError
from django.db import Error, transaction
from django.db.models import F, Max, QuerySet
from django.utils import timezone

from crowd.explorations.measuring import queries
from crowd.explorations.measuring.measurement import CannotMeasureHereError, find_packs
from crowd.explorations.models import MAX_BUDGET, Evaluation, Exploration
from crowd.explorations.objectives import MEASURED
from crowd.explorations.preparing import preparation
from crowd.explorations.searching import baseline_configurations, batches, points, ratios, search, warm_start
from crowd.explorations.searching.applications import (
    SEVERAL,
    application_of,
    applications,
    measured_parameters,
)
from crowd.explorations.searching.baseline_configurations import DEFAULT
from crowd.explorations.searching.batches import WantedEvaluation
from crowd.explorations.searching.search import COPIED, FINISHED, SEARCHED
from pareto import Explorer
from pareto.errors import ParetoError
from pareto.search.methods import METHODS
from slam.definitions import complete, without_optional
from slam.devices.build import split
from slam.public_text import one_line

# Repeats change medians, and thus the front, which may need further repeats. This limits the rounds.
MAX_REPEAT_ROUNDS = 3
MAY_CONTINUE = (Exploration.State.RUNNING, Exploration.State.PAUSED, Exploration.State.DONE)

log = logging.getLogger(__name__)


def validate(exploration: Exploration) -> None:
    """Raise ValidationError if a new exploration cannot run. Its message says what would be right."""
    exploration.full_clean()
    names = exploration.objectives
    if not isinstance(names, list) or not set(map(str, names)) <= set(MEASURED):
        raise ValidationError(f"objectives {names!r} must be a list of {', '.join(MEASURED)}")
    several = " and ".join(applications(exploration)) if exploration.application == SEVERAL else ""
    if several and ratios.uses_ratio(exploration):
        raise ValidationError(
            f"objectives {names!r}: a ratio compares with one default, but {several} have one each: use "
            "runtime and ate_max"
        )
    if not isinstance(exploration.limits, dict):
        raise ValidationError(f"limits {exploration.limits!r} must map objectives to upper bounds")
    if not isinstance(exploration.options, dict):
        raise ValidationError(f"options {exploration.options!r} must map the method's options to numbers")
    earlier = exploration.warm_start_from
    if earlier is not None and earlier.application != exploration.application:
        raise ValidationError(f"{earlier} explores {earlier.application}: choose one of the same application")
    try:
        if earlier is None:
            search.new_explorer(exploration).propose(1)
        else:
            warm_start.check_warm_start(exploration, earlier)
        packs = find_packs(exploration, [*exploration.learned_on, *exploration.held_out_sequences])
    except (ParetoError, CannotMeasureHereError) as error:
        raise ValidationError(str(error)) from error
    names = [pack["name"] for _, pack in packs]
    if twice := [name for index, name in enumerate(names) if name in names[:index]]:
        raise ValidationError(
            f"sequence {twice[0]} is named twice: name each once, either to learn on or held out"
        )
    for _, pack in packs:
        if exploration.frames is not None and exploration.frames > pack["frames"]:
            raise ValidationError(f"frames {exploration.frames}: {pack['name']} has {pack['frames']}")


@transaction.atomic
def create(exploration: Exploration, known: Sequence[Mapping[str, Any]] = ()) -> Exploration:
    """Store a new exploration, copied measurements of an earlier one, and the known configurations.

    `known`: further ones to measure before the search. Raises ValidationError if it cannot run.
    """
    validate(exploration)
    try:
        for configuration in known:
            parameters, _ = split(measured_parameters(exploration, configuration))
            complete(application_of(exploration, configuration), parameters)
    except ValueError as error:
        raise ValidationError(f"a known configuration cannot run: {error}") from error
    exploration.save()
    if exploration.warm_start_from is not None:
        Evaluation.objects.bulk_create(warm_start.copies(exploration, exploration.warm_start_from))
    space = search.search_space(exploration)
    given = baseline_configurations.baseline_configurations(exploration.application, space)
    labels = {batches.configuration_digest(one): (one, label) for label, one in given.items()}
    for configuration in map(without_optional, known):
        labels.setdefault(batches.configuration_digest(configuration), (configuration, ""))
    batches.add_evaluations(
        exploration,
        [(configuration, Evaluation.Phase.GIVEN, label) for configuration, label in labels.values()],
        iteration=0,
    )
    return exploration


def clone(exploration: Exploration, **changes: Any) -> Exploration:
    """An unsaved copy of `exploration` with `changes`."""
    kept = {
        field.name: getattr(exploration, field.name)
        for field in Exploration._meta.concrete_fields
        if field.name not in {"id", "state", "note", "command", "sha256", "created_at", "finished_at"}
    }
    return Exploration(**(kept | changes))


@transaction.atomic
def pause(exploration: Exploration) -> None:
    """Start no further measurements until it is resumed. Running ones are finished."""
    _lock(exploration, Exploration.State.RUNNING)
    _change(exploration, state=Exploration.State.PAUSED, note="")


@transaction.atomic
def resume(exploration: Exploration) -> None:
    """Resume a paused exploration. A preparation keeps the note why it paused: it tries that once more."""
    _lock(exploration, Exploration.State.PAUSED)
    note = "" if exploration.prepares_id is None else exploration.note
    _change(exploration, state=Exploration.State.RUNNING, note=note)


@transaction.atomic
def cancel(exploration: Exploration) -> None:
    """End the exploration. Results stay; running measurements are dropped."""
    _lock(exploration, Exploration.State.RUNNING, Exploration.State.PAUSED)
    _change(exploration, state=Exploration.State.CANCELLED, finished_at=timezone.now())
    exploration.evaluations.filter(state=Evaluation.State.RUNNING).update(
        state=Evaluation.State.PENDING, lease_until=None
    )


@transaction.atomic
def raise_budget(exploration: Exploration, budget: int) -> None:
    """Raise the budget to `budget` configurations in total. A finished exploration continues."""
    _lock(exploration, *MAY_CONTINUE)
    if budget <= exploration.budget:
        raise ValidationError(f"budget {budget}: it is {exploration.budget} already, give a larger one")
    if budget > MAX_BUDGET:
        raise ValidationError(f"budget {budget}: give {MAX_BUDGET} at most")
    _change(exploration, budget=budget)
    _reopen(exploration)


@transaction.atomic
def retry_failures(exploration: Exploration) -> int:
    """Measure failed evaluations again; returns how many. A finished exploration continues.

    If runtimes are relative to the default, these evaluations become a new round with its own default.
    """
    _lock(exploration, *MAY_CONTINUE)
    failed = exploration.evaluations.filter(state=Evaluation.State.FAILED).exclude(phase__in=COPIED)
    rows = list(failed)
    # The worker of an earlier, lost lease must not fail it again.
    changes = {"state": Evaluation.State.PENDING, "attempt": F("attempt") + 1, "losses": 0}
    if rows and (default := batches.round_default(exploration)) is not None:
        last = exploration.evaluations.aggregate(last=Max("iteration"))["last"]
        changes["iteration"] = 1 + last
        phases = [(Evaluation.Phase.DEFAULT, False), (Evaluation.Phase.REPEAT, True)]
        missing = [phase for phase, repeats in phases if ratios.lacks_default(rows, repeats)]
        batches.add_evaluations(exploration, [(default, phase, DEFAULT) for phase in missing], 1 + last)
    count = failed.update(**changes, error="", finished_at=None)
    if count:
        _reopen(exploration)
    return count


@transaction.atomic
def measure_again(
    exploration: Exploration, configurations: Sequence[tuple[Mapping[str, Any], str]], times: int
) -> list[Evaluation]:
    """Measure each (configuration, label) `times` more over the whole sequence, in turn.

    Returns the new evaluations. A finished exploration runs again until they are measured.
    """
    if times < 1 or not configurations:
        raise ValidationError(
            f"{times} times {len(configurations)} configurations: give at least one of each"
        )
    _lock(exploration, *MAY_CONTINUE)
    _reopen(exploration)
    return batches.add_evaluations(
        exploration,
        batches.repeat_rounds(
            [(configuration, label, times) for configuration, label in configurations],
            batches.round_default(exploration),
        ),
    )


def advance(exploration_id: int) -> list[Evaluation]:
    """Learn from the measurements and propose more. Returns the new evaluations in order.

    First, new measurements get their ratios, if the search minimises one. Nothing happens unless `is_due`. A
    proposal may take seconds, so it is made outside the transaction; of two concurrent ones, one is used. If
    no proposal is possible, the exploration pauses with the reason in its note. A preparation asks for its
    next round instead.
    """
    exploration = Exploration.objects.get(pk=exploration_id)
    if exploration.state != Exploration.State.RUNNING or not is_due(exploration):
        return []
    if exploration.prepares_id is not None:
        return preparation.advance(exploration_id)
    try:
        evaluations = search.read_rows(exploration)
        ratios.fill_ratios(exploration, evaluations)
        return _ask_search(exploration, evaluations)
    except Error:
        raise
    except Exception as error:
        log.exception("%s cannot go on", exploration)
        kind = "" if isinstance(error, ParetoError) else f"{type(error).__name__}: "
        Exploration.objects.filter(pk=exploration_id, state=Exploration.State.RUNNING).update(
            state=Exploration.State.PAUSED, note=one_line(f"the search cannot go on: {kind}{error}")
        )
        return []


def is_due(exploration: Exploration) -> bool:
    """Whether it can propose more: everything is finished, or, if asynchronous, half a batch."""
    most = 0 if exploration.synchronous else exploration.batch // 2
    return queries.unfinished(exploration.pk, most + 1) <= most


def pending_evaluations(exploration: Exploration) -> list[Evaluation]:
    """The pending evaluations in order."""
    return list(exploration.evaluations.filter(state=Evaluation.State.PENDING))


def unfinished_evaluations(exploration: Exploration) -> QuerySet[Evaluation]:
    """The pending and running evaluations."""
    return exploration.evaluations.filter(state__in=(Evaluation.State.PENDING, Evaluation.State.RUNNING))


def _ask_search(exploration: Exploration, evaluations: Sequence[Evaluation]) -> list[Evaluation]:
    """Continue the search; after it, repeat the best points; after these, finish."""
    explorer = search.informed_explorer(exploration, evaluations)
    searched = _search(exploration, evaluations, explorer)
    wanted = [*searched, *batches.measured_again(exploration, evaluations)]
    unfinished = sum(row.state not in FINISHED for row in evaluations)
    if not wanted and not unfinished:
        wanted = _repeats(exploration)
    with transaction.atomic():
        present = Exploration.objects.select_for_update().get(pk=exploration.pk)
        if present.state != Exploration.State.RUNNING or present.budget != exploration.budget:
            return []
        # Numbers are never reused, so their count shows whether another process proposed meanwhile. More
        # unfinished evaluations than before are failures that shall be measured again.
        if (
            present.evaluations.count() != len(evaluations)
            or unfinished_evaluations(present).count() > unfinished
        ):
            return []
        if wanted:
            with_default = batches.with_default(exploration, wanted)
            return batches.add_evaluations(exploration, with_default, history=explorer.history)
        if not unfinished:
            present.state, present.finished_at = Exploration.State.DONE, timezone.now()
            present.save(update_fields=["state", "finished_at"])
        return []


def _search(
    exploration: Exploration, evaluations: Sequence[Evaluation], explorer: Explorer
) -> list[WantedEvaluation]:
    """The next proposals, or outliers to check first; nothing after the budget is used up."""
    if exploration.recheck and (far := search.outliers(exploration, evaluations)):
        chosen = exploration.evaluations.filter(pk__in=[row.pk for row in far])
        again: list[WantedEvaluation] = [
            (row.configuration, Evaluation.Phase.CHECK, row.label) for row in chosen
        ]
        return again * search.CHECKS
    left = exploration.budget - sum(row.phase in SEARCHED for row in evaluations)
    if left <= 0:
        return []
    of_batch = (row for row in evaluations if row.phase != Evaluation.Phase.DEFAULT)
    unfinished = sum(row.state not in FINISHED for row in of_batch)
    count = left if METHODS[exploration.method].whole_rounds else min(exploration.batch - unfinished, left)
    proposals = explorer.propose(count)
    return [(without_optional(proposal.configuration), proposal.phase, "") for proposal in proposals]


def _repeats(exploration: Exploration) -> list[WantedEvaluation]:
    """Points worth publishing that were not yet measured `repeats` times over the whole sequence."""
    if exploration.repeats == 0:
        return []
    evaluations = list(exploration.evaluations.all())
    repeats = [row for row in evaluations if row.phase == Evaluation.Phase.REPEAT]
    newest = max((row.iteration for row in evaluations if row.phase in SEARCHED), default=0)
    rounds = {row.iteration for row in repeats if row.iteration > newest}
    if len(rounds) >= MAX_REPEAT_ROUNDS:
        return []
    measured = [row for row in evaluations if row.phase != Evaluation.Phase.PRIOR]
    missing = []
    recommended = search.recommended_configurations(exploration, search.read_rows(exploration))
    for point in points.worth_publishing(exploration, measured, recommended):
        so_far = sum(row.configuration_key == point.key for row in repeats)
        missing.append((point.configuration, point.label, exploration.repeats - so_far))
    return batches.repeat_rounds(missing, batches.round_default(exploration))


def _lock(exploration: Exploration, *possible: str) -> None:
    """Read and lock the row until the end of the transaction.

    Raises ValidationError if its state is not one of `possible`, or if it was measured elsewhere.
    """
    exploration.refresh_from_db(from_queryset=Exploration.objects.select_for_update())
    if machine := exploration.reference_device.elsewhere:
        raise ValidationError(
            f"{exploration} was measured elsewhere, on {machine}, and cannot continue here: start a new "
            f"exploration from it (frontrunner admin exploration start --warm-start {exploration.pk} ...)"
        )
    if exploration.state not in possible:
        raise ValidationError(
            f"{exploration} is {exploration.state}: this needs the state {' or '.join(possible)}"
        )


def _change(exploration: Exploration, **changes: Any) -> None:
    """Store `changes` of the locked row."""
    for name, value in changes.items():
        setattr(exploration, name, value)
    exploration.save(update_fields=list(changes))


def _reopen(exploration: Exploration) -> None:
    """Let a finished exploration run again. A paused one stays paused."""
    if exploration.state == Exploration.State.DONE:
        _change(exploration, state=Exploration.State.RUNNING, finished_at=None, note="")
