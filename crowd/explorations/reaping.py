"""Evaluations whose worker is gone: their leases ran out, or their process is known to be dead."""

from django.db.models import F, Q
from django.utils import timezone

from crowd.explorations import workers
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
    lost = Evaluation.objects.filter(gone, state=Evaluation.State.RUNNING)
    lost.filter(losses__gte=MOST_LOSSES - 1).update(
        state=Evaluation.State.FAILED,
        losses=F("losses") + 1,
        lease_until=None,
        finished_at=timezone.now(),
        error=f"lost {MOST_LOSSES} times: its worker died while measuring it",
    )
    lost.update(state=Evaluation.State.PENDING, lease_until=None, losses=F("losses") + 1)
    running = Exploration.objects.filter(state=Exploration.State.RUNNING)
    return list(running.select_related("reference_device").order_by("pk"))
