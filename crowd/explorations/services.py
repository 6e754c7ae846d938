"""Writes of explorations: create, advance, lease, record, reap. The row is the truth, messages are hints."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import timedelta
from typing import Any

from django.core.exceptions import ValidationError
from django.db import transaction
from django.db.models import F, Q
from django.utils import timezone

from crowd.explorations import known, points, software
from crowd.explorations.measurement import LeaseLostError, Measurement, MeasurementError, pack_of
from crowd.explorations.models import Evaluation, Exploration
from pareto import Explorer, Space
from pareto.errors import ConfigurationError, ParetoError

MEASURED = (
    "runtime",
    "ate_max",
    "ate_mean",
    "ate_rmse",
    "ate_rmse_aligned",
    "cpu_seconds",
    "peak_memory_bytes",
)
LEASE = timedelta(seconds=90)  # several heartbeats: a busy machine is not a dead one
MOST_ATTEMPTS = 3
FINISHED = (Evaluation.State.DONE, Evaluation.State.FAILED)
SEARCHED = (Evaluation.Phase.RANDOM, Evaluation.Phase.ACTIVE)


def check(exploration: Exploration) -> None:
    """Raise ValidationError where a new exploration cannot be run: its message says what would be right."""
    exploration.full_clean(exclude=["search"])
    names = exploration.objectives
    if not isinstance(names, list) or not set(map(str, names)) <= set(MEASURED):
        raise ValidationError(f"objectives {names!r} must be a list of {', '.join(MEASURED)}")
    if not isinstance(exploration.limits, dict):
        raise ValidationError(f"limits {exploration.limits!r} must map objectives to upper bounds")
    try:
        _fresh_explorer(exploration)
        pack_of(exploration)
    except (ParetoError, MeasurementError) as error:
        raise ValidationError(str(error)) from error


@transaction.atomic
def create(exploration: Exploration) -> Exploration:
    """Store a new exploration and the measurements of its application's known configurations.

    Raises ValidationError where it cannot be run.
    """
    check(exploration)
    space = Space.from_dict(exploration.space)
    exploration.search = _fresh_explorer(exploration).state()
    exploration.save()
    _add(
        exploration,
        [
            (configuration, Evaluation.Phase.GIVEN, label)
            for label, configuration in known.configurations(exploration.application, space).items()
        ],
    )
    return exploration


def advance(exploration_id: int) -> list[Evaluation]:
    """Learn from what was measured and ask for more; return the new evaluations, in order.

    Nothing happens while something asked for is not finished. Asking takes seconds and is done outside of
    the transaction: of two who ask at once one is heard.
    """
    exploration = Exploration.objects.get(pk=exploration_id)
    unfinished = exploration.evaluations.exclude(state__in=FINISHED)
    if exploration.state != Exploration.State.RUNNING or unfinished.exists():
        return []
    return _ask(exploration, list(exploration.evaluations.all()))


def waiting(exploration: Exploration) -> list[Evaluation]:
    """What nobody measures yet, in order."""
    return list(exploration.evaluations.filter(state=Evaluation.State.PENDING))


@contextmanager
def leased(evaluation_id: int) -> Iterator[Evaluation | None]:
    """The evaluation, held for as long as it is measured; None where it is finished or someone else's.

    A MeasurementError inside makes it a failed evaluation. Any other exception gives it back.
    """
    now = timezone.now()
    free = Q(state=Evaluation.State.PENDING) | Q(state=Evaluation.State.RUNNING, lease_until__lt=now)
    taken = Evaluation.objects.filter(
        free, pk=evaluation_id, exploration__state=Exploration.State.RUNNING
    ).update(state=Evaluation.State.RUNNING, attempt=F("attempt") + 1, lease_until=now + LEASE)
    if not taken:
        yield None
        return
    evaluation = Evaluation.objects.select_related("exploration__reference_device").get(pk=evaluation_id)
    try:
        yield evaluation
    except MeasurementError as error:
        fail(evaluation, str(error))
    except LeaseLostError:
        return
    except BaseException:
        _held(evaluation).update(state=Evaluation.State.PENDING, lease_until=None)
        raise


def renew(evaluation: Evaluation) -> bool:
    """Hold the evaluation for longer; False where the lease is lost."""
    return bool(_held(evaluation).update(lease_until=timezone.now() + LEASE))


def record(evaluation: Evaluation, measurement: Measurement) -> bool:
    """Store a measurement; False, and nothing stored, where the lease is lost."""
    return bool(
        _held(evaluation).update(
            state=Evaluation.State.DONE,
            lease_until=None,
            finished_at=timezone.now(),
            objectives=measurement.objectives,
            stages=measurement.stages,
            device=measurement.device,
            software=software.version(),
        )
    )


def fail(evaluation: Evaluation, reason: str) -> bool:
    """Store that the configuration cannot be measured; False where the lease is lost."""
    return bool(
        _held(evaluation).update(
            state=Evaluation.State.FAILED,
            lease_until=None,
            finished_at=timezone.now(),
            error=reason or "no reason given",
            software=software.version(),
        )
    )


def reap() -> list[Exploration]:
    """Give back evaluations whose holder is gone; return the explorations that run.

    One that took down its worker MOST_ATTEMPTS times is failed, since it would do so again.
    """
    lost = Evaluation.objects.filter(state=Evaluation.State.RUNNING, lease_until__lt=timezone.now())
    lost.filter(attempt__gte=MOST_ATTEMPTS).update(
        state=Evaluation.State.FAILED,
        lease_until=None,
        finished_at=timezone.now(),
        error=f"lost {MOST_ATTEMPTS} times: its worker died while measuring it",
    )
    lost.update(state=Evaluation.State.PENDING, lease_until=None)
    running = Exploration.objects.filter(state=Exploration.State.RUNNING)
    return list(running.order_by("pk"))


def stop(exploration: Exploration) -> None:
    """Measure nothing more of a running exploration; what is measured stays."""
    Exploration.objects.filter(pk=exploration.pk, state=Exploration.State.RUNNING).update(
        state=Exploration.State.STOPPED, finished_at=timezone.now()
    )


def key(configuration: Mapping[str, Any]) -> str:
    """A digest by which measurements of one configuration find each other."""
    return hashlib.sha256(json.dumps(configuration, sort_keys=True).encode()).hexdigest()


def _ask(exploration: Exploration, evaluations: list[Evaluation]) -> list[Evaluation]:
    """Everything asked for is finished: search on, measure the best again, or be done."""
    explorer = Explorer.restore(Space.from_dict(exploration.space), exploration.search)
    _tell(explorer, evaluations, exploration.objectives)
    searched = sum(evaluation.phase in SEARCHED for evaluation in evaluations)
    proposals = explorer.propose(min(exploration.batch, exploration.budget - searched))
    wanted = [(proposal.configuration, proposal.phase, "") for proposal in proposals]
    if not wanted and not any(evaluation.phase == Evaluation.Phase.REPEAT for evaluation in evaluations):
        chosen = points.worth_publishing(exploration, evaluations)
        # Round after round, so that a slow drift of the machine meets every point alike.
        wanted = [
            (point.configuration, Evaluation.Phase.REPEAT, point.label)
            for _ in range(exploration.repeats)
            for point in chosen
        ]
    with transaction.atomic():
        present = Exploration.objects.select_for_update().get(pk=exploration.pk)
        if present.search != exploration.search or present.state != Exploration.State.RUNNING:
            return []
        if wanted:
            exploration.search = explorer.state()
            exploration.save(update_fields=["search"])
            return _add(exploration, wanted)
        exploration.state, exploration.finished_at = Exploration.State.DONE, timezone.now()
        exploration.save(update_fields=["state", "finished_at"])
        return []


def _fresh_explorer(exploration: Exploration) -> Explorer:
    return Explorer(
        Space.from_dict(exploration.space),
        exploration.objectives,
        exploration.limits,
        seed=exploration.seed,
        method=exploration.method,
    )


def _tell(explorer: Explorer, evaluations: list[Evaluation], objectives: list[str]) -> None:
    """Tell what the explorer does not know: what it asked for, and given configurations in its space."""
    for evaluation in evaluations:
        if evaluation.phase == Evaluation.Phase.REPEAT:
            continue
        try:
            index = explorer.space.encode(evaluation.configuration)
        except ConfigurationError:
            continue  # a given configuration beside the grid
        if index in explorer.history.told:
            continue
        found = evaluation.objectives or {}
        values = {name: found[name] for name in objectives} if set(objectives) <= set(found) else None
        explorer.tell([evaluation.configuration], [values], phase=evaluation.phase)


def _add(exploration: Exploration, wanted: list[tuple[dict[str, Any], str, str]]) -> list[Evaluation]:
    first = exploration.evaluations.count()
    return Evaluation.objects.bulk_create(
        Evaluation(
            exploration=exploration,
            number=first + place,
            phase=phase,
            label=label,
            configuration=configuration,
            configuration_key=key(configuration),
        )
        for place, (configuration, phase, label) in enumerate(wanted)
    )


def _held(evaluation: Evaluation) -> Any:
    """The row, if EVALUATION still holds its lease."""
    return Evaluation.objects.filter(
        pk=evaluation.pk, state=Evaluation.State.RUNNING, attempt=evaluation.attempt
    )
