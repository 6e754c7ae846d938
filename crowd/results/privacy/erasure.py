"""What a participant may ask to be gone: one run, or everything. A tombstone without a name remains."""

import hashlib
from collections.abc import Callable, Iterable
from functools import partial
from typing import TypeVar
from uuid import UUID

from django.db import IntegrityError, OperationalError, transaction
from django.db.models import Q, QuerySet
from django.utils import timezone

from crowd.devices.models import DeviceDescription, DeviceModel, Installation
from crowd.results.figures import cohorts as cohort_figures
from crowd.results.figures import sessions as session_figures
from crowd.results.models import Cohort, MeasurementSession, Run, SessionSummary, Tombstone
from crowd.results.opendata import exports
from crowd.results.privacy import disclosure

AT_ONCE = 1_000
TRIES = 3
DEADLOCK = "40P01"  # PostgreSQL's code

T = TypeVar("T")


def erase_installation(installation: Installation) -> None:
    """Delete everything of INSTALLATION, compute the figures that held it anew, withdraw such exports."""
    _persist(partial(_erase_installation, installation.pk))


def erase_run(installation: Installation, uuid: UUID) -> bool:
    """Delete one run of INSTALLATION, and its session with the last one; False where there is none."""
    return _persist(partial(_erase_run, installation.pk, uuid))


def _persist(erase: Callable[[], T]) -> T:
    """What ERASE answers, which is tried again where something came in meanwhile that refers to what it
    deletes, or where it and another writer waited for each other.
    """
    for _ in range(TRIES - 1):
        try:
            with transaction.atomic():
                return erase()
        except IntegrityError:
            continue
        except OperationalError as error:
            if getattr(error.__cause__, "sqlstate", None) != DEADLOCK:
                raise
    with transaction.atomic():
        return erase()


def _erase_installation(key: UUID) -> None:
    # Nothing of it may come in meanwhile.
    installation = Installation.objects.select_for_update().filter(pk=key).first()
    if installation is None:
        return
    _lock_models(installation.sessions.all())
    sessions = list(installation.sessions.select_for_update().defer("samples").order_by("pk"))
    runs = Run.objects.filter(session__installation=installation).values_list("uuid", flat=True)
    cohorts = _locked(SessionSummary.objects.filter(session__installation=installation))
    # Nothing simulated was ever public: nobody has to be told that it is gone.
    if not installation.simulated:
        _bury(Tombstone.Kind.RUN, runs.iterator())
        _bury(Tombstone.Kind.SESSION, (session.uuid for session in sessions))
        Tombstone.objects.create(kind=Tombstone.Kind.INSTALLATION, erased_at=timezone.now())
    installation.delete()
    _after(sessions, cohorts)


def _erase_run(key: UUID, uuid: UUID) -> bool:
    """Whether there was such a run."""
    # One request of an installation at a time: who asks for the last two runs at once erases the session.
    list(Installation.objects.select_for_update(no_key=True).filter(pk=key))
    holding = Run.objects.filter(uuid=uuid).values("session")
    own = MeasurementSession.objects.filter(installation=key, pk__in=holding)
    _lock_models(own)
    session = own.select_for_update(of=("self",)).select_related("installation").first()
    if session is None:
        return False
    public = not session.installation.simulated
    run = session.runs.get(uuid=uuid)
    if public:
        _bury(Tombstone.Kind.RUN, [run.uuid])
    run.delete()
    if session.runs.exists():
        exports.withdraw(session.received_at)
        session_figures.summarise_session(session.pk)
        return True
    cohorts = _locked(session.summaries.all())
    places = set(session.summaries.values_list("cohort_id", "installation_id", "day"))
    if public:
        _bury(Tombstone.Kind.SESSION, [session.uuid])
    session.delete()
    # A later session of that day may count in its place.
    cohort_figures.count_days_of(places)
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


def _lock_models(sessions: QuerySet[MeasurementSession]) -> None:
    """Nobody else decides whether the models of SESSIONS are rare, until the transaction ends."""
    described = DeviceDescription.objects.filter(sessions__in=sessions)
    shown = Q(pk__in=described.values("model")) | Q(pk__in=described.values("model__canonical"))
    list(DeviceModel.objects.select_for_update(no_key=True).filter(shown).order_by("pk").values_list("pk"))


def _locked(summaries: QuerySet[SessionSummary]) -> list[Cohort]:
    """The cohorts of SUMMARIES, whose sessions are locked already."""
    return cohort_figures.lock(Cohort.objects.filter(pk__in=summaries.values("cohort")))


def _after(sessions: list[MeasurementSession], cohorts: list[Cohort]) -> None:
    """Figures without the deleted SESSIONS. Descriptions and models that no session names any more go, too;
    who measured the others is counted again.
    """
    if not sessions:
        return
    descriptions = {session.description_id for session in sessions}
    models = set(DeviceDescription.objects.filter(pk__in=descriptions).values_list("model", flat=True))
    exports.withdraw(min(session.received_at for session in sessions))
    cohort_figures.refresh(cohorts)
    session_figures.count_activity({session.device_id for session in sessions})
    disclosure.after_erasure(models)
