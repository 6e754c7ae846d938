"""Writes of explorations: create, steer, go on. The row is the truth, messages are hints."""

import logging
from collections.abc import Mapping, Sequence
from typing import Any

from django.core.exceptions import ValidationError
from django.db import Error, transaction
from django.db.models import F, Max, QuerySet
from django.utils import timezone

from crowd.explorations.measuring import queries
from crowd.explorations.measuring.measurement import CannotMeasureHereError, find_packs
from crowd.explorations.models import MOST_BUDGET, Evaluation, Exploration
from crowd.explorations.objectives import MEASURED
from crowd.explorations.searching import baseline_configurations, batches, points, ratios, search, warm_start
from crowd.explorations.searching.baseline_configurations import DEFAULT
from crowd.explorations.searching.batches import Wanted
from crowd.explorations.searching.search import COPIED, FINISHED, SEARCHED
from pareto.errors import ParetoError
from slam.public_text import one_line

# Repeats change medians, and these what belongs to the front: it is looked at again, but not for ever.
MOST_ROUNDS_OF_REPEATS = 3
MAY_GO_ON = (Exploration.State.RUNNING, Exploration.State.PAUSED, Exploration.State.DONE)

log = logging.getLogger(__name__)


def check(exploration: Exploration) -> None:
    """Raise ValidationError where a new exploration cannot be run: its message says what would be right."""
    exploration.full_clean()
    names = exploration.objectives
    if not isinstance(names, list) or not set(map(str, names)) <= set(MEASURED):
        raise ValidationError(f"objectives {names!r} must be a list of {', '.join(MEASURED)}")
    if not isinstance(exploration.limits, dict):
        raise ValidationError(f"limits {exploration.limits!r} must map objectives to upper bounds")
    if not isinstance(exploration.options, dict):
        raise ValidationError(f"options {exploration.options!r} must map the method's options to numbers")
    earlier = exploration.warm_start_from
    if earlier is not None and earlier.application != exploration.application:
        raise ValidationError(f"{earlier} explores {earlier.application}: choose one of the same application")
    try:
        if earlier is None:
            search.fresh(exploration).propose(1)
        else:
            warm_start.check(exploration, earlier)
        packs = find_packs(exploration, [*exploration.learned_on, *exploration.held_out_sequences])
    except (ParetoError, CannotMeasureHereError) as error:
        raise ValidationError(str(error)) from error
    names = [pack["name"] for _, pack in packs]
    if twice := [name for place, name in enumerate(names) if name in names[:place]]:
        raise ValidationError(
            f"sequence {twice[0]} is named twice: name each once, either to learn on or held out"
        )
    for _, pack in packs:
        if exploration.frames is not None and exploration.frames > pack["frames"]:
            raise ValidationError(f"frames {exploration.frames}: {pack['name']} has {pack['frames']}")


@transaction.atomic
def create(exploration: Exploration) -> Exploration:
    """Store a new exploration, what an earlier one knows, and the known configurations to be measured.

    Raises ValidationError where it cannot be run.
    """
    check(exploration)
    exploration.save()
    if exploration.warm_start_from is not None:
        Evaluation.objects.bulk_create(warm_start.copies(exploration, exploration.warm_start_from))
    space = search.space_of(exploration)
    given = baseline_configurations.configurations(exploration.application, space).items()
    batches.add(
        exploration,
        [(configuration, Evaluation.Phase.GIVEN, label) for label, configuration in given],
        iteration=0,
    )
    return exploration


def clone(exploration: Exploration, **changes: Any) -> Exploration:
    """A new exploration with the same wishes but for CHANGES, not stored yet: `create` does that."""
    kept = {
        field.name: getattr(exploration, field.name)
        for field in Exploration._meta.concrete_fields
        if field.name not in {"id", "state", "note", "command", "created_at", "finished_at"}
    }
    return Exploration(**(kept | changes))


@transaction.atomic
def pause(exploration: Exploration) -> None:
    """Begin no further measurement until it is resumed; what is being measured now is finished."""
    _lock(exploration, Exploration.State.RUNNING)
    _change(exploration, state=Exploration.State.PAUSED, note="")


@transaction.atomic
def resume(exploration: Exploration) -> None:
    """Go on with a paused exploration."""
    _lock(exploration, Exploration.State.PAUSED)
    _change(exploration, state=Exploration.State.RUNNING, note="")


@transaction.atomic
def cancel(exploration: Exploration) -> None:
    """Measure nothing more of it, for good; what is measured stays, what is being measured is given up."""
    _lock(exploration, Exploration.State.RUNNING, Exploration.State.PAUSED)
    _change(exploration, state=Exploration.State.CANCELLED, finished_at=timezone.now())
    exploration.evaluations.filter(state=Evaluation.State.RUNNING).update(
        state=Evaluation.State.PENDING, lease_until=None
    )


@transaction.atomic
def raise_budget(exploration: Exploration, budget: int) -> None:
    """Search up to BUDGET configurations in all; a finished exploration goes on."""
    _lock(exploration, *MAY_GO_ON)
    if budget <= exploration.budget:
        raise ValidationError(f"budget {budget}: it is {exploration.budget} already, give a larger one")
    if budget > MOST_BUDGET:
        raise ValidationError(f"budget {budget}: give {MOST_BUDGET} at most")
    _change(exploration, budget=budget)
    _go_on(exploration)


@transaction.atomic
def retry_failures(exploration: Exploration) -> int:
    """Measure once more what failed; how many evaluations that are. A finished exploration goes on.

    Where runtimes are compared with the default's, these evaluations become a new round with its own default.
    """
    _lock(exploration, *MAY_GO_ON)
    failed = exploration.evaluations.filter(state=Evaluation.State.FAILED).exclude(phase__in=COPIED)
    rows = list(failed)
    # The holder of a former lease, which was given up for dead, must not fail it again.
    changes = {"state": Evaluation.State.PENDING, "attempt": F("attempt") + 1, "losses": 0}
    if rows and (default := batches.default_of(exploration)) is not None:
        last = exploration.evaluations.aggregate(last=Max("iteration"))["last"]
        changes["iteration"] = 1 + last
        phases = [(Evaluation.Phase.DEFAULT, False), (Evaluation.Phase.REPEAT, True)]
        missing = [phase for phase, repeats in phases if ratios.lacks_default(rows, repeats)]
        batches.add(exploration, [(default, phase, DEFAULT) for phase in missing], 1 + last)
    count = failed.update(**changes, error="", finished_at=None)
    if count:
        _go_on(exploration)
    return count


@transaction.atomic
def measure_again(
    exploration: Exploration, configurations: Sequence[tuple[Mapping[str, Any], str]], times: int
) -> list[Evaluation]:
    """Ask for (configuration, label) TIMES more over the whole sequence, in turn; the new evaluations.

    A finished exploration runs again until they are measured.
    """
    if times < 1 or not configurations:
        raise ValidationError(
            f"{times} times {len(configurations)} configurations: give at least one of each"
        )
    _lock(exploration, *MAY_GO_ON)
    _go_on(exploration)
    return batches.add(
        exploration,
        batches.rounds(
            [(configuration, label, times) for configuration, label in configurations],
            batches.default_of(exploration),
        ),
    )


def advance(exploration_id: int) -> list[Evaluation]:
    """Learn from what was measured and ask for more; return the new evaluations, in order.

    First each new measurement gets its `runtime_ratio`, where the search minimises that. Nothing happens
    while it is not `due`. Asking may take seconds and is done outside of the transaction: of
    two who ask at once one is heard. Where asking is impossible the exploration pauses, with the reason in
    its note: to try again every minute would not make it possible.
    """
    exploration = Exploration.objects.get(pk=exploration_id)
    if exploration.state != Exploration.State.RUNNING or not due(exploration):
        return []
    try:
        return _ask(exploration, search.with_ratios(exploration, search.rows_of(exploration)))
    except Error:
        raise
    except Exception as error:
        log.exception("%s cannot go on", exploration)
        kind = "" if isinstance(error, ParetoError) else f"{type(error).__name__}: "
        Exploration.objects.filter(pk=exploration_id, state=Exploration.State.RUNNING).update(
            state=Exploration.State.PAUSED, note=one_line(f"the search cannot go on: {kind}{error}")
        )
        return []


def due(exploration: Exploration) -> bool:
    """Whether it can ask for more: all is finished, or half a batch where it is not synchronous."""
    most = 0 if exploration.synchronous else exploration.batch // 2
    return queries.unfinished(exploration.pk, most + 1) <= most


def waiting(exploration: Exploration) -> list[Evaluation]:
    """What nobody measures yet, in order."""
    return list(exploration.evaluations.filter(state=Evaluation.State.PENDING))


def unfinished_of(exploration: Exploration) -> QuerySet[Evaluation]:
    """What is still to be measured, or being measured now."""
    return exploration.evaluations.filter(state__in=(Evaluation.State.PENDING, Evaluation.State.RUNNING))


def _ask(exploration: Exploration, evaluations: Sequence[search.Row]) -> list[Evaluation]:
    """Search on; then measure the best again; then be done."""
    wanted = _search(exploration, evaluations)
    unfinished = sum(row.state not in FINISHED for row in evaluations)
    if not wanted and not unfinished:
        wanted = _repeats(exploration)
    with transaction.atomic():
        present = Exploration.objects.select_for_update().get(pk=exploration.pk)
        if present.state != Exploration.State.RUNNING or present.budget != exploration.budget:
            return []
        # A number is never given back, so that their count shows whether someone else asked meanwhile; and
        # more that is unfinished than before is what failed and shall be measured once more.
        if present.evaluations.count() != len(evaluations) or unfinished_of(present).count() > unfinished:
            return []
        if wanted:
            return batches.add(exploration, batches.with_default(exploration, wanted))
        if not unfinished:
            present.state, present.finished_at = Exploration.State.DONE, timezone.now()
            present.save(update_fields=["state", "finished_at"])
        return []


def _search(exploration: Exploration, evaluations: Sequence[search.Row]) -> list[Wanted]:
    """The next of the search, or outliers to be checked first; nothing once the budget is used up."""
    if exploration.recheck and (far := search.outliers(exploration, evaluations)):
        chosen = exploration.evaluations.filter(pk__in=[row.pk for row in far])
        again: list[Wanted] = [(row.configuration, Evaluation.Phase.CHECK, row.label) for row in chosen]
        return again * search.CHECKS
    left = exploration.budget - sum(row.phase in SEARCHED for row in evaluations)
    if left <= 0:
        return []
    of_batch = (row for row in evaluations if row.phase != Evaluation.Phase.DEFAULT)
    unfinished = sum(row.state not in FINISHED for row in of_batch)
    count = left if search.whole_rounds(exploration) else min(exploration.batch - unfinished, left)
    proposals = search.explorer(exploration, evaluations).propose(count)
    return [(proposal.configuration, proposal.phase, "") for proposal in proposals]


def _repeats(exploration: Exploration) -> list[Wanted]:
    """What is worth publishing and was not yet measured `repeats` times over the whole sequence."""
    if exploration.repeats == 0:
        return []
    evaluations = list(exploration.evaluations.all())
    repeats = [row for row in evaluations if row.phase == Evaluation.Phase.REPEAT]
    newest = max((row.iteration for row in evaluations if row.phase in SEARCHED), default=0)
    rounds = {row.iteration for row in repeats if row.iteration > newest}
    if len(rounds) >= MOST_ROUNDS_OF_REPEATS:
        return []
    own = [row for row in evaluations if row.phase != Evaluation.Phase.PRIOR]
    missing = []
    recommended = search.recommended(exploration, search.rows_of(exploration))
    for point in points.worth_publishing(exploration, own, recommended):
        wanted = batches.key(point.configuration)
        so_far = sum(row.configuration_key == wanted for row in repeats)
        missing.append((point.configuration, point.label, exploration.repeats - so_far))
    return batches.rounds(missing, batches.default_of(exploration))


def _lock(exploration: Exploration, *possible: str) -> None:
    """Read the row as it is now, and keep it so to the end of the transaction.

    Raises ValidationError where it is in none of the POSSIBLE states.
    """
    exploration.refresh_from_db(from_queryset=Exploration.objects.select_for_update())
    if exploration.state not in possible:
        raise ValidationError(
            f"{exploration} is {exploration.state}: this needs one that is {' or '.join(possible)}"
        )


def _change(exploration: Exploration, **changes: Any) -> None:
    """Store CHANGES of a locked row."""
    for name, value in changes.items():
        setattr(exploration, name, value)
    exploration.save(update_fields=list(changes))


def _go_on(exploration: Exploration) -> None:
    """Let a finished exploration run again; one that is paused stays so."""
    if exploration.state == Exploration.State.DONE:
        _change(exploration, state=Exploration.State.RUNNING, finished_at=None, note="")
