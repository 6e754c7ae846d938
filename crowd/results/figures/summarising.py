"""Sessions become summaries. Everything here can be run again at any time, beside anybody else who does."""

from collections.abc import Iterable, Sequence

from django.db import transaction
from django.db.models import Q, QuerySet
from django.utils import timezone

from crowd.devices.models import Installation
from crowd.prepared import insert
from crowd.results.figures import batches, refreshing
from crowd.results.figures.batches import Group, Waiting
from crowd.results.models import Cohort, DeviceActivity, MeasurementSession, SessionSummary, WorkerPulse
from crowd.results.validity import version
from crowd.results.validity.decisions import Decisions

# Sessions that one transaction works on: other writers wait for a fraction of a second at most.
BATCH = 100
MARKED = 5_000
# A device with more sessions gets its figures from the sweep, for many new sessions at once: what one more
# session costs does not grow with those that are there.
LARGE = 1_000
# In place of the version of the statistics that has seen a session: to be summarised again.
AGAIN = 0


def waiting() -> QuerySet[MeasurementSession]:
    """Sessions that the present statistics have not seen: new ones, and all after a change of algorithm."""
    return MeasurementSession.objects.filter(
        Q(summary_algorithm=None) | Q(summary_algorithm__lt=version.ALGORITHM)
    ).order_by("id")


def resummarise(sessions: QuerySet[MeasurementSession]) -> int:
    """Let SESSIONS wait for a summary from their raw runs; how many. Their present ones hold until then."""
    last, marked = 0, 0
    seen = sessions.exclude(summary_algorithm=None).order_by("pk")
    while keys := list(seen.filter(pk__gt=last).values_list("pk", flat=True)[:MARKED]):
        MeasurementSession.objects.filter(pk__in=keys).update(summary_algorithm=AGAIN)
        last, marked = keys[-1], marked + len(keys)
    return marked


def summarise_waiting(limit: int | None = None, figures: bool = True) -> list[int]:
    """Summarise sessions that wait, at most LIMIT, new ones first and then oldest first; their keys.

    Without FIGURES, those stay as they are until `refreshing.refresh_stale`.
    """
    done: list[int] = []
    for sessions in (waiting().filter(summary_algorithm=None), waiting().exclude(summary_algorithm=None)):
        last = 0
        while room := BATCH if limit is None else min(BATCH, limit - len(done)):
            keys = list(sessions.filter(pk__gt=last).values_list("pk", flat=True)[:room])
            if not keys:
                break
            summarise_sessions(keys, figures)
            last = keys[-1]
            done += keys
    return done


def pulse(task: str) -> None:
    """Note that TASK ran now."""
    WorkerPulse.objects.update_or_create(task=task, defaults={"at": timezone.now()})


@transaction.atomic
def summarise_sessions(keys: Sequence[int], figures: bool = True) -> None:
    """Judge the runs of the sessions KEYS, summarise them and, with FIGURES, compute what rests on them.

    Sessions that are gone are left out. The figures of large devices wait for `refreshing.refresh_stale`.
    """
    lock_installations(MeasurementSession.objects.filter(pk__in=keys))
    sessions = batches.locked(keys)
    present = [session.key for session in sessions]
    earlier = SessionSummary.objects.filter(session__in=present)
    places = set(earlier.values_list("cohort_id", "installation_id", "day"))
    # A session whose device was renamed or merged leaves its cohort for another.
    cohorts = _cohorts(sessions, {cohort for cohort, _, _ in places})
    if places:
        earlier.delete()
    made = batches.summaries(
        sessions, {row.key: cohorts[row.group].pk for row in sessions}, Decisions.on(present)
    )
    insert(made)
    # Where a session has left, a later one may count in its place.
    refreshing.count_days_of(places | {(row.cohort_id, row.installation_id, row.day) for row in made})
    done = MeasurementSession.objects.filter(pk__in=present)
    done.update(summary_algorithm=version.ALGORITHM)
    small = _small(cohorts.values(), sessions) if figures else set()
    refreshing.refresh([cohort for cohort in cohorts.values() if cohort.device_id in small])
    refreshing.count_activity(small)
    later = [row.pk for row in cohorts.values() if row.device_id not in small and not row.stale]
    if later:
        Cohort.objects.filter(pk__in=later).update(stale=True)


def summarise_session(key: int) -> None:
    """Compute the session's summaries and its device's figures; nothing for a session that is gone."""
    summarise_sessions([key])


def lock_installations(sessions: QuerySet[MeasurementSession]) -> None:
    """Let nobody erase the installations of SESSIONS until the transaction ends.

    Writers lock installations first, then models, sessions and cohorts, each in the order of their keys, so
    that no two wait for each other. `no_key`: what only refers to the rows may be stored meanwhile.
    """
    rows = Installation.objects.filter(pk__in=sessions.order_by().values("installation"))
    list(rows.select_for_update(no_key=True).order_by("pk").values_list("pk"))


def _small(cohorts: Iterable[Cohort], sessions: Iterable[Waiting]) -> set[int]:
    """Keys of the devices of COHORTS and SESSIONS whose figures are quickly computed."""
    devices = {cohort.device_id for cohort in cohorts} | {session.device for session in sessions}
    large = DeviceActivity.objects.filter(device__in=devices, sessions__gt=LARGE)
    return devices - set(large.values_list("device_id", flat=True))


def _group(cohort: Cohort) -> Group:
    return cohort.device_id, cohort.front_id, cohort.backend, cohort.processor


def _cohorts(sessions: Iterable[Waiting], left: set[int]) -> dict[Group, Cohort]:
    """The cohorts of SESSIONS, made on first sight, and those with the keys LEFT; all locked."""
    groups = {session.group for session in sessions}
    of_devices = Cohort.objects.filter(Q(pk__in=left) | Q(device__in={group[0] for group in groups}))
    found = {
        _group(cohort): cohort
        for cohort in refreshing.lock(of_devices)
        if cohort.pk in left or _group(cohort) in groups
    }
    for group in sorted(groups - found.keys()):
        device, front, backend, processor = group
        made, _ = Cohort.objects.get_or_create(
            device_id=device, front_id=front, backend=backend, processor=processor
        )
        # Somebody else may have made it just now.
        [found[group]] = refreshing.lock(Cohort.objects.filter(pk=made.pk))
    return found
