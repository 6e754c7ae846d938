"""Erases measurements: one run, all of an installation, or selected sessions.

An anonymous tombstone remains of each. The same transaction computes figures again and marks the files of the
open data that contain erased data as stale.
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
from crowd.results import marking
from crowd.results.figures import cohorts as cohort_figures
from crowd.results.figures import sessions as session_figures
from crowd.results.models import (
    Cohort,
    Decision,
    MeasurementSession,
    Run,
    RunFrames,
    SessionSummary,
    Tombstone,
)
from crowd.results.privacy import disclosure_sync
from crowd.results.privacy.signals import measurements_erased

CHUNK = 500
MAX_TRIES = 3
DEADLOCK = "40P01"  # PostgreSQL's code

T = TypeVar("T")


def erase_installation(installation: Installation) -> None:
    """Erase everything of `installation` in one transaction."""
    _with_retries(partial(_erase_installation, installation.pk))


def erase_run(installation: Installation, uuid: UUID) -> bool:
    """Erase a run of `installation`, and its session if it was the last. Returns False for an unknown run."""
    return _with_retries(partial(_erase_run, installation.pk, uuid))


def erase_sessions(keys: Iterable[int]) -> None:
    """Erase the sessions `keys` in one transaction. Those that are gone already are skipped."""
    _with_retries(partial(_erase_sessions, sorted(keys)))


def _with_retries(erase: Callable[[], T]) -> T:
    """The result of `erase`, which is repeated after a deadlock, or if new rows refer to deleted ones."""
    for _ in range(MAX_TRIES - 1):
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
    # The lock keeps new submissions out.
    installation = Installation.objects.select_for_update().filter(pk=key).first()
    if installation is None:
        return
    _delete_sessions(installation.sessions.all())
    Tombstone.objects.create(kind=Tombstone.Kind.INSTALLATION, erased_at=timezone.now())
    installation.delete()


def _erase_sessions(keys: list[int]) -> None:
    sessions = MeasurementSession.objects.filter(pk__in=keys)
    owners = Installation.objects.filter(pk__in=sessions.order_by().values("installation"))
    list(owners.select_for_update(no_key=True).order_by("pk").values_list("pk"))
    _delete_sessions(sessions)


def _erase_run(key: UUID, uuid: UUID) -> bool:
    """Erase the run UUID of the installation `key`. Returns whether it existed."""
    # One request of an installation at a time, so that erasing the last two runs at once erases the session.
    list(Installation.objects.select_for_update(no_key=True).filter(pk=key))
    holding = Run.objects.filter(uuid=uuid).values("session")
    sessions = MeasurementSession.objects.filter(installation=key, pk__in=holding)
    _lock_models(sessions)
    session = sessions.select_for_update(of=("self",)).select_related("installation").first()
    if session is None:
        return False
    run = session.runs.get(uuid=uuid)
    _create_tombstones(Tombstone.Kind.RUN, [run.uuid], single=True)
    run.delete()
    if not session.runs.exists():
        _delete_sessions(MeasurementSession.objects.filter(pk=session.pk))
        return True
    cohorts = _lock_cohorts(session.summaries.all())
    session_figures.summarise_session(session.pk)
    # The figures of large devices, too: they must not contain the run.
    left = [cohort.pk for cohort in cohorts]
    cohort_figures.refresh_figures(
        cohort_figures.lock_cohorts(Cohort.objects.filter(pk__in=left, stale=True))
    )
    measurements_erased.send(sender=Run, cohorts=cohorts)
    marking.mark_erased([session.pk])
    return True


def _delete_sessions(sessions: QuerySet[MeasurementSession]) -> None:
    """Delete `sessions`, whose installations are locked, with their derived data."""
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
    models = _models_of(rows)
    day_keys = {
        day_key
        for chunk in _chunks(keys)
        for day_key in SessionSummary.objects.filter(session__in=chunk).values_list(
            "cohort_id", "installation_id", "day"
        )
    }
    cohorts = cohort_figures.lock_cohorts(Cohort.objects.filter(pk__in={cohort for cohort, _, _ in day_keys}))
    for chunk in _chunks(keys):
        _create_tombstones(
            Tombstone.Kind.RUN, Run.objects.filter(session__in=chunk).values_list("uuid", flat=True)
        )
    _create_tombstones(Tombstone.Kind.SESSION, (row.uuid for row in rows))
    for chunk in _chunks(keys):
        # Rows that refer to them first, so that Django loads little before it deletes.
        RunFrames.objects.filter(run__session__in=chunk).delete()
        for table in (SessionSummary, Decision, Run):
            table.objects.filter(session__in=chunk).only("pk").delete()
        MeasurementSession.objects.filter(pk__in=chunk).only("pk").delete()
    # A later session of a day may count instead of a deleted one.
    cohort_figures.apply_daily_limit_at(day_keys)
    measurements_erased.send(sender=MeasurementSession, cohorts=cohorts)
    cohort_figures.refresh_figures(cohorts)
    session_figures.count_activity({row.device_id for row in rows})
    disclosure_sync.after_erasure(models)
    marking.mark_erased(keys)


def _models_of(sessions: Iterable[MeasurementSession]) -> set[int]:
    descriptions = {session.description_id for session in sessions}
    return {
        model
        for chunk in _chunks(sorted(descriptions))
        for model in DeviceDescription.objects.filter(pk__in=chunk).values_list("model", flat=True)
    }


def _create_tombstones(kind: Tombstone.Kind, ids: Iterable[UUID], single: bool = False) -> None:
    """Store a tombstone for each of `ids`. As ids are random, a digest only helps those who know the id."""
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
        batch_size=CHUNK,
    )


def _lock_models(sessions: QuerySet[MeasurementSession]) -> None:
    """Lock the models of `sessions`, so that no other transaction decides whether they are rare."""
    described = DeviceDescription.objects.filter(sessions__in=sessions)
    shown = Q(pk__in=described.values("model")) | Q(pk__in=described.values("model__canonical"))
    list(DeviceModel.objects.select_for_update(no_key=True).filter(shown).order_by("pk").values_list("pk"))


def _lock_cohorts(summaries: QuerySet[SessionSummary]) -> list[Cohort]:
    """Lock the cohorts of `summaries`. Their sessions must be locked already."""
    return cohort_figures.lock_cohorts(Cohort.objects.filter(pk__in=summaries.values("cohort")))


def _chunks(keys: list[int]) -> list[list[int]]:
    """`keys` in chunks that every database accepts in one statement."""
    return [keys[start : start + CHUNK] for start in range(0, len(keys), CHUNK)]
