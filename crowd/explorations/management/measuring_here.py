"""Measures an exploration in this process, with a line for each measurement."""

import time
from collections.abc import Callable
from datetime import datetime

from django.core.management.base import CommandError
from django.utils import timezone

from crowd.explorations import services
from crowd.explorations.measuring import leases, reaping
from crowd.explorations.measuring.measurement import CannotMeasureHereError, evaluator
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.searching.search import FINISHED
from wire.protocol import VALID_BELOW

LOOK_AGAIN_SECONDS = 1.0
Say = Callable[[str], object]


def measure_here(exploration: Exploration, say: Say) -> None:
    """Measure until `exploration` is done. Workers of a running server may help. `say` gets each line.

    Raises CommandError if it is paused or cancelled, or if this machine cannot measure it.
    """
    printed = timezone.now()
    while exploration.state == Exploration.State.RUNNING:
        waiting = services.pending_evaluations(exploration) or services.advance(exploration.pk)
        for evaluation in waiting:
            try:
                _measure(evaluation)
            except CannotMeasureHereError as error:
                raise CommandError(str(error)) from error
            printed = _say_finished(exploration, printed, say)
        if not waiting and services.unfinished_evaluations(exploration).exists():
            time.sleep(LOOK_AGAIN_SECONDS)  # another worker measures
            reaping.reap()
        printed = _say_finished(exploration, printed, say)
        exploration.refresh_from_db()
    if exploration.state != Exploration.State.DONE:
        why = f" ({exploration.note})" if exploration.note else ""
        raise CommandError(f"{exploration} is {exploration.state}{why}: no front was written")


def _measure(waiting: Evaluation) -> None:
    with leases.leased(waiting.pk) as evaluation:
        if evaluation is not None:
            leases.record(evaluation, evaluator()(evaluation, lambda: leases.renew(evaluation)))


def _say_finished(exploration: Exploration, since: datetime, say: Say) -> datetime:
    """Say a line about each evaluation finished after `since`. Returns when the last one finished."""
    rows = exploration.evaluations.filter(state__in=FINISHED, finished_at__gt=since)
    for row in rows.order_by("finished_at"):
        say(f"{row.number:4} {row.phase:9} {row.label:9}{_outcome(row)}")
        since = row.finished_at or since
    return since


def _outcome(evaluation: Evaluation) -> str:
    if evaluation.objectives is None:
        return f" failed: {evaluation.error}"
    runtime, error = (evaluation.objectives.get(name, float("inf")) for name in ("runtime", "ate_max"))
    if (reference := evaluation.reference) is not None:
        return f"{len(reference['variants']):3} variants, band {1e3 * reference['band']:.1f} mm"
    mark = "" if error < VALID_BELOW else "  not valid"
    least = ">=" if "ate_max" in evaluation.censored else ""
    return f"{1e3 * runtime:9.2f} ms a frame {least + f'{1e3 * error:.1f}':>8} mm{mark}"
