"""What a participant may ask to be gone: one run, or everything. A tombstone without a name remains."""

import hashlib
from collections.abc import Iterable
from uuid import UUID

from django.db import transaction
from django.db.models import QuerySet
from django.utils import timezone

from crowd.devices.models import DeviceDescription, Installation
from crowd.results import publication, refreshing, summarising
from crowd.results.models import Cohort, MeasurementSession, Run, SessionSummary, Tombstone
from crowd.results.opendata import exports

AT_ONCE = 1_000


@transaction.atomic
def erase_installation(installation: Installation) -> None:
    """Delete everything of INSTALLATION, compute the figures that held it anew, withdraw such exports."""
    # Nothing of it may come in meanwhile.
    list(Installation.objects.select_for_update().filter(pk=installation.pk))
    sessions = list(installation.sessions.select_for_update().defer("samples").order_by("pk"))
    runs = Run.objects.filter(session__installation=installation).values_list("uuid", flat=True)
    cohorts = _locked(SessionSummary.objects.filter(session__installation=installation))
    _bury(Tombstone.Kind.RUN, runs.iterator())
    _bury(Tombstone.Kind.SESSION, (session.uuid for session in sessions))
    Tombstone.objects.create(kind=Tombstone.Kind.INSTALLATION, erased_at=timezone.now())
    installation.delete()
    _after(sessions, cohorts)


@transaction.atomic
def erase_run(installation: Installation, uuid: UUID) -> bool:
    """Delete one run of INSTALLATION, and its session with the last one; False where there is none."""
    own = Run.objects.filter(session__installation=installation).select_related("session")
    run = own.filter(uuid=uuid).first()
    if run is None:
        return False
    session = run.session
    _bury(Tombstone.Kind.RUN, [run.uuid])
    run.delete()
    if session.runs.exists():
        exports.withdraw(session.received_at)
        summarising.summarise_session(session.pk)
    else:
        cohorts = _locked(session.summaries.all())
        _bury(Tombstone.Kind.SESSION, [session.uuid])
        session.delete()
        _after([session], cohorts)
    return True


def _bury(kind: Tombstone.Kind, ids: Iterable[UUID]) -> None:
    """A tombstone for each of IDS, which are random: their digests tell only those who have them already."""
    now = timezone.now()
    Tombstone.objects.bulk_create(
        (
            Tombstone(kind=kind, id_sha256=hashlib.sha256(str(each).encode()).hexdigest(), erased_at=now)
            for each in ids
        ),
        batch_size=AT_ONCE,
    )


def _locked(summaries: QuerySet[SessionSummary]) -> list[Cohort]:
    """The cohorts of SUMMARIES, whose sessions are locked already."""
    return refreshing.lock(Cohort.objects.filter(pk__in=summaries.values("cohort")))


def _after(sessions: list[MeasurementSession], cohorts: list[Cohort]) -> None:
    """Figures without the deleted SESSIONS; descriptions and models that nobody's session names go too."""
    if not sessions:
        return
    descriptions = {session.description_id for session in sessions}
    models = set(DeviceDescription.objects.filter(pk__in=descriptions).values_list("model", flat=True))
    exports.withdraw(min(session.received_at for session in sessions))
    refreshing.refresh(cohorts)
    refreshing.count_activity({session.device_id for session in sessions})
    publication.after_erasure(models)
