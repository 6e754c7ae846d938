"""Published figures of cohorts from their session summaries, what hides an outlier, counts per device."""

from collections import defaultdict
from collections.abc import Collection, Iterable
from datetime import date
from uuid import UUID

from django.db import transaction
from django.db.models import Avg, Count, Max, Q, QuerySet

from crowd.results.figures import statistics, summaries
from crowd.results.models import (
    Cohort,
    DeviceActivity,
    DeviceSpeedup,
    MeasurementSession,
    SessionSummary,
    State,
)
from crowd.results.validity import measures, rules, version

FIGURE = (
    "baseline", "algorithm", "speedup", "low", "high", "repeat_low", "repeat_high", "sessions",
    "installations", "ate_max", "state", "last_session_at", "computed_at",
)  # fmt: skip


def lock(cohorts: QuerySet[Cohort]) -> list[Cohort]:
    """COHORTS, nobody else's until the transaction ends.

    Taken in one order, and after the locks on sessions, so that no two writers wait for each other.
    """
    return list(cohorts.select_for_update().order_by("pk"))


def refresh_stale(limit: int | None = None) -> int:
    """Compute the figures of at most LIMIT cohorts that do not know their newest sessions; how many."""
    keys = list(Cohort.objects.filter(stale=True).order_by("pk").values_list("pk", flat=True)[:limit])
    for key in keys:
        with transaction.atomic():
            cohorts = lock(Cohort.objects.filter(pk=key))
            refresh(cohorts)
            count_activity({cohort.device_id for cohort in cohorts})
    return len(keys)


def refresh(cohorts: Iterable[Cohort]) -> None:
    """Compute the figures of COHORTS, which the caller has locked. Cohorts without sessions go."""
    for cohort in cohorts:
        own = SessionSummary.objects.filter(cohort=cohort)
        quarantine_outliers(own)
        found = summaries.figures(own)
        _store(cohort, found)
        if not found and not own.exists():
            cohort.delete()
        elif cohort.stale:
            Cohort.objects.filter(pk=cohort.pk).update(stale=False)


def _store(cohort: Cohort, found: dict[summaries.Key, summaries.Figure]) -> None:
    group = {
        "device_id": cohort.device_id,
        "front_id": cohort.front_id,
        "backend": cohort.backend,
        "processor": cohort.processor,
    }
    stale = DeviceSpeedup.objects.filter(**group)
    stale.exclude(configuration_id__in=[key.configuration for key in found]).delete()
    DeviceSpeedup.objects.bulk_create(
        [
            DeviceSpeedup(
                **group,
                configuration_id=key.configuration,
                baseline_id=key.baseline,
                algorithm=version.ALGORITHM,
                **figure.numbers,
                state=figure.state,
                last_session_at=figure.last_session_at,
            )
            for key, figure in found.items()
        ],
        update_conflicts=True,
        unique_fields=["front", "configuration", "device", "backend", "processor"],
        update_fields=FIGURE,
    )


def quarantine_outliers(cohort: QuerySet[SessionSummary]) -> None:
    """Hide the valid sessions of COHORT, one cohort's summaries, that lie outside the usual range of its
    installations, as long as no session of another installation agrees; those that one agrees with count.

    The range comes from all of them, hidden or not, so that the outcome does not depend on what was hidden
    before.
    """
    is_hidden = Q(state=rules.OUTLIER.state, reason=rules.OUTLIER.code)
    judged = cohort.filter(Q(state=State.VALID) | is_hidden)
    values: dict[int, list[float]] = defaultdict(list)
    means = (
        judged.order_by()
        .values("configuration_id", "installation_id")
        .annotate(mean=Avg("log_ratio"), hidden=Count("pk", filter=is_hidden))
    )
    before = 0
    for row in means:
        values[row["configuration_id"]].append(row["mean"])
        before += row["hidden"]
    hidden: set[int] = set()
    for configuration, logs in values.items():
        usual = statistics.usual_range(logs)
        if usual is not None:
            hidden.update(_outliers(judged.filter(configuration_id=configuration), *usual))
    known = set(judged.filter(is_hidden).values_list("pk", flat=True)) if before else set()
    change(cohort, hidden - known, rules.OUTLIER.state, rules.OUTLIER.code)
    change(cohort, known - hidden, State.VALID, "")


def _outliers(judged: QuerySet[SessionSummary], low: float, high: float) -> list[int]:
    """Keys of the sessions below LOW or above HIGH that no other installation's session agrees with.

    Those that an administrator released are none.
    """
    outside = Q(log_ratio__lt=low + measures.AGREEMENT) | Q(log_ratio__gt=high - measures.AGREEMENT)
    found = judged.filter(outside).values_list("pk", "installation_id", "log_ratio", "reason")
    rows = [(key, who, value, reason) for key, who, value, reason in found if value is not None]
    alone = statistics.without_agreement([(who, value) for _, who, value, _ in rows])
    return [
        key
        for (key, _, value, reason), lonely in zip(rows, alone, strict=True)
        if lonely and not low <= value <= high and reason != rules.RELEASED.code
    ]


def change(cohort: QuerySet[SessionSummary], keys: Collection[int], state: State, reason: str) -> None:
    """Give the summaries KEYS of COHORT a state, and find anew which of their days' sessions count."""
    if not keys:
        return
    changed = cohort.filter(pk__in=keys)
    days = list(changed.values_list("installation_id", "day").distinct())
    changed.update(state=state, reason=reason)
    count_days(cohort.filter(installation_id__in={who for who, _ in days}, day__in={day for _, day in days}))


def count_days_of(places: Iterable[tuple[int, UUID, date]]) -> None:
    """Find anew which sessions count on the days of PLACES: cohort, installation and day."""
    found = set(places)
    if found:
        cohorts, installations, days = zip(*found, strict=True)
        count_days(
            SessionSummary.objects.filter(cohort__in=cohorts, installation__in=installations, day__in=days)
        )


def count_days(cohort_days: QuerySet[SessionSummary]) -> None:
    """Mark which of those sessions count: the first few of each installation, day, cohort and state.

    COHORT_DAYS holds days as a whole.
    """
    rows = list(
        cohort_days.order_by("started_at", "session_id").values_list(
            "pk", "counted", "cohort_id", "configuration_id", "installation_id", "day", "state", "log_ratio"
        )
    )
    usable = [row for row in rows if row[-1] is not None]
    limited = statistics.within_daily_limit(row[2:7] for row in usable)
    counted = {row[0] for row, first in zip(usable, limited, strict=True) if first}
    for value in (True, False):
        wrong = [row[0] for row in rows if (row[0] in counted) is value and row[1] is not value]
        if wrong:
            SessionSummary.objects.filter(pk__in=wrong).update(counted=value)


def count_activity(devices: Iterable[int]) -> None:
    """Count the sessions and installations of DEVICES anew; a device without any has no row."""
    found = (
        MeasurementSession.objects.filter(device_id__in=set(devices))
        .order_by("device_id")
        .values("device_id")
        .annotate(
            sessions=Count("id"), installations=Count("installation", distinct=True), last=Max("started_at")
        )
    )
    rows = [
        DeviceActivity(
            device_id=row["device_id"],
            sessions=row["sessions"],
            installations=row["installations"],
            last_session_at=row["last"],
        )
        for row in found
    ]
    gone = set(devices) - {row.device_id for row in rows}
    DeviceActivity.objects.filter(device_id__in=gone).delete()
    DeviceActivity.objects.bulk_create(
        rows,
        update_conflicts=True,
        unique_fields=["device"],
        update_fields=["sessions", "installations", "last_session_at"],
    )
