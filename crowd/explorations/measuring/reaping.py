"""Evaluations whose worker is gone: their leases ran out, or their process is known to be dead."""

from django.db import transaction
from django.db.models import F, Q, QuerySet
from django.utils import timezone

from crowd.explorations.measuring import workers
from crowd.explorations.models import Evaluation, Exploration

MOST_LOSSES = 3


def reap() -> list[Exploration]:
    """Give back evaluations whose holder is gone; return the explorations that run.

    One that was lost MOST_LOSSES times is failed, since it would take down its next worker too.
    """
    return _reap(Q(lease_until__lt=timezone.now()))


def reap_after_restart() -> list[Exploration]:
    """As `reap`, and at once what a process of this machine held that is no longer alive."""
    running = Evaluation.objects.filter(
        state=Evaluation.State.RUNNING, worker__startswith=workers.of_this_machine()
    )
    holders = set(running.values_list("worker", flat=True))
    dead = [worker for worker in holders if not workers.alive(worker)]
    return _reap(Q(lease_until__lt=timezone.now()) | Q(worker__in=dead))


def _reap(gone: Q) -> list[Exploration]:
    with transaction.atomic():
        # A row that somebody changes at this moment is left for the next time: who waits for no lock cannot
        # be one of two that lock the same rows in different orders and wait for each other.
        found = Evaluation.objects.select_for_update(skip_locked=True).filter(
            gone, state=Evaluation.State.RUNNING
        )
        _give_up(Evaluation.objects.filter(pk__in=list(found.values_list("pk", flat=True))))
    running = Exploration.objects.filter(state=Exploration.State.RUNNING)
    return list(running.select_related("reference_device").order_by("pk"))


def _give_up(lost: QuerySet[Evaluation]) -> None:
    lost.filter(losses__gte=MOST_LOSSES - 1).update(
        state=Evaluation.State.FAILED,
        losses=F("losses") + 1,
        lease_until=None,
        finished_at=timezone.now(),
        error=f"lost {MOST_LOSSES} times: its worker died while measuring it",
    )
    lost.filter(state=Evaluation.State.RUNNING).update(
        state=Evaluation.State.PENDING, lease_until=None, losses=F("losses") + 1
    )
