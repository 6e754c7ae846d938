"""Returns evaluations of lost workers: with an expired lease, or a process that is known to be dead."""

from datetime import timedelta

from django.conf import settings
from django.db import transaction
from django.db.models import F, Q, QuerySet
from django.utils import timezone

from crowd.explorations.measuring import workers
from crowd.explorations.models import Evaluation, Exploration

MAX_LOSSES = 3


def reap() -> list[Exploration]:
    """Return the evaluations of lost workers to the pending ones. Returns the running explorations.

    An evaluation that was lost MAX_LOSSES times fails, since it would probably crash its next worker, too.
    """
    return _reap(Q(lease_until__lt=timezone.now()))


def reap_after_restart() -> list[Exploration]:
    """As `reap`, and without waiting for leases of dead processes of this machine."""
    running = Evaluation.objects.filter(
        state=Evaluation.State.RUNNING, worker__startswith=workers.machine_prefix()
    )
    holders = set(running.values_list("worker", flat=True))
    dead = [worker for worker in holders if not workers.is_alive(worker)]
    return _reap(Q(lease_until__lt=timezone.now()) | Q(worker__in=dead))


def _reap(gone: Q) -> list[Exploration]:
    # A lease that ends later than any can was taken before the clock was set back.
    longest = timezone.now() + timedelta(seconds=settings.FRONTRUNNER_LEASE_SECONDS)
    Evaluation.objects.filter(state=Evaluation.State.RUNNING, lease_until__gt=longest).update(
        lease_until=longest
    )
    with transaction.atomic():
        # Locked rows are skipped until the next time, which avoids deadlocks.
        evaluations = Evaluation.objects.select_for_update(skip_locked=True).filter(
            gone, state=Evaluation.State.RUNNING
        )
        _release(Evaluation.objects.filter(pk__in=list(evaluations.values_list("pk", flat=True))))
    running = Exploration.objects.filter(state=Exploration.State.RUNNING)
    return list(running.select_related("reference_device").order_by("pk"))


def _release(lost: QuerySet[Evaluation]) -> None:
    lost.filter(losses__gte=MAX_LOSSES - 1).update(
        state=Evaluation.State.FAILED,
        losses=F("losses") + 1,
        lease_until=None,
        finished_at=timezone.now(),
        error=f"lost {MAX_LOSSES} times: its worker died while measuring it",
    )
    lost.filter(state=Evaluation.State.RUNNING).update(
        state=Evaluation.State.PENDING, lease_until=None, losses=F("losses") + 1
    )
