"""Deletes measurements for good: one run, all of an installation, or chosen sessions.

A tombstone without a name remains of each. Figures are computed again in the same transaction, and the files
of the open data that hold what was erased are marked as stale.
"""

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
from crowd.results.models import Cohort, Decision, MeasurementSession, Run, SessionSummary, Tombstone
from crowd.results.opendata import marking
from crowd.results.privacy import disclosure
from crowd.results.privacy.signals import measurements_erased

AT_ONCE = 500
TRIES = 3
DEADLOCK = "40P01"  # PostgreSQL's code

T = TypeVar("T")


def erase_installation(installation: Installation) -> None:
    """Delete everything of INSTALLATION in one transaction."""
    _persist(partial(_erase_installation, installation.pk))


def erase_run(installation: Installation, uuid: UUID) -> bool:
    """Delete one run of INSTALLATION, and its session with the last one; False where there is no such run."""
    return _persist(partial(_erase_run, installation.pk, uuid))


def erase_sessions(keys: Iterable[int]) -> None:
    """Delete the sessions KEYS in one transaction; those that are gone already are left out."""
    _persist(partial(_erase_chosen, sorted(keys)))


def _persist(erase: Callable[[], T]) -> T:
    """What ERASE returns. It is repeated when rows arrived meanwhile that refer to the deleted ones, or when
    it and another writer waited for each other.
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
    # Nothing of it may arrive meanwhile.
    installation = Installation.objects.select_for_update().filter(pk=key).first()
    if installation is None:
        return
    _delete_sessions(installation.sessions.all())
    # Nothing simulated was ever public: nobody has to learn that it is gone.
    if not installation.simulated:
        Tombstone.objects.create(kind=Tombstone.Kind.INSTALLATION, erased_at=timezone.now())
    installation.delete()


def _erase_chosen(keys: list[int]) -> None:
    sessions = MeasurementSession.objects.filter(pk__in=keys)
    owners = Installation.objects.filter(pk__in=sessions.order_by().values("installation"))
    list(owners.select_for_update(no_key=True).order_by("pk").values_list("pk"))
    _delete_sessions(sessions)


def _erase_run(key: UUID, uuid: UUID) -> bool:
    """Whether there was such a run."""
    # One request of an installation at a time: two that ask for the last two runs erase the session.
    list(Installation.objects.select_for_update(no_key=True).filter(pk=key))
    holding = Run.objects.filter(uuid=uuid).values("session")
    own = MeasurementSession.objects.filter(installation=key, pk__in=holding)
    _lock_models(own)
    session = own.select_for_update(of=("self",)).select_related("installation").first()
    if session is None:
        return False
    run = session.runs.get(uuid=uuid)
    public = not session.installation.simulated
    if public:
        _bury(Tombstone.Kind.RUN, [run.uuid], single=True)
    run.delete()
    if not session.runs.exists():
        _delete_sessions(MeasurementSession.objects.filter(pk=session.pk))
        return True
    cohorts = _locked(session.summaries.all())
    session_figures.summarise_session(session.pk)
    # The figures of large devices, too: nothing of the run may remain in them.
    left = [cohort.pk for cohort in cohorts]
    cohort_figures.refresh(cohort_figures.lock(Cohort.objects.filter(pk__in=left, stale=True)))
    measurements_erased.send(sender=Run, cohorts=cohorts)
    if public:
        marking.mark_erased([session.pk])
    return True


def _delete_sessions(sessions: QuerySet[MeasurementSession]) -> None:
    """Delete SESSIONS, whose installations are locked, with what was derived from them."""
    _lock_models(sessions)
    rows = list(
        sessions.select_for_update(of=("self",))
        .select_related("installation")
        .defer("samples", "extra")
        .order_by("pk")
    )
    if not rows:
        return
    keys = [row.pk for row in rows]
    public = [row for row in rows if not row.installation.simulated]
    models = _models_of(rows)
    places = {
        place
        for part in _parts(keys)
        for place in SessionSummary.objects.filter(session__in=part).values_list(
            "cohort_id", "installation_id", "day"
        )
    }
    cohorts = cohort_figures.lock(Cohort.objects.filter(pk__in={cohort for cohort, _, _ in places}))
    for part in _parts([row.pk for row in public]):
        _bury(Tombstone.Kind.RUN, Run.objects.filter(session__in=part).values_list("uuid", flat=True))
    _bury(Tombstone.Kind.SESSION, (row.uuid for row in public))
    for part in _parts(keys):
        # What refers to them goes first, so that little is loaded to be deleted.
        for table in (SessionSummary, Decision, Run):
            table.objects.filter(session__in=part).only("pk").delete()
        MeasurementSession.objects.filter(pk__in=part).only("pk").delete()
    # A later session of a day may count in place of a deleted one.
    cohort_figures.count_days_of(places)
    measurements_erased.send(sender=MeasurementSession, cohorts=cohorts)
    cohort_figures.refresh(cohorts)
    session_figures.count_activity({row.device_id for row in rows})
    disclosure.after_erasure(models)
    if public:
        marking.mark_erased([row.pk for row in public])


def _models_of(sessions: Iterable[MeasurementSession]) -> set[int]:
    descriptions = {session.description_id for session in sessions}
    return {
        model
        for part in _parts(sorted(descriptions))
        for model in DeviceDescription.objects.filter(pk__in=part).values_list("model", flat=True)
    }


def _bury(kind: Tombstone.Kind, ids: Iterable[UUID], single: bool = False) -> None:
    """A tombstone for each of IDS. They are random: a digest says something only to those who have the id."""
    now = timezone.now()
    Tombstone.objects.bulk_create(
        (
            Tombstone(
                kind=kind,
                id_sha256=hashlib.sha256(str(each).encode()).hexdigest(),
                erased_at=now,
                single=single,
            )
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


def _parts(keys: list[int]) -> list[list[int]]:
    """KEYS in parts that every database takes in one statement."""
    return [keys[start : start + AT_ONCE] for start in range(0, len(keys), AT_ONCE)]
