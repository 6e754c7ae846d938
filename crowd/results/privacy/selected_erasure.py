"""Erasure by an administrator: all data of selected installations, a network, a device model or a period.

It works in batches, each of which is a complete erasure. After an interruption, start it again with the same
selection: it erases the rest.
"""

from dataclasses import dataclass
from datetime import datetime
from uuid import UUID

from django.db.models import Q, QuerySet
from django.utils import timezone

from crowd.audit.services import record
from crowd.devices.models import DeviceModel, Installation
from crowd.results.models import Cohort, MeasurementSession, Run
from crowd.results.privacy import erasure

# Sessions per transaction, so that other writers wait for a second at most.
BATCH = 200
MAX_LISTED = 100
STARTED, FINISHED = "measurements: erasing", "measurements: erased"


@dataclass(frozen=True)
class Selection:
    """What to erase: everything that meets all given conditions. `until` is exclusive.

    Without a device and a period, whole installations are erased, otherwise only sessions. Raises ValueError
    without a condition.
    """

    installations: tuple[UUID, ...] = ()
    network: str = ""
    device: str = ""
    since: datetime | None = None
    until: datetime | None = None

    def __post_init__(self) -> None:
        if not (self.installations or self.network or self.device or self.since or self.until):
            raise ValueError("select installations, a network, a device model or a period")

    @property
    def of_whole_installations(self) -> bool:
        """Whether whole installations are erased, with their tokens."""
        return not (self.device or self.since or self.until)

    @property
    def conditions(self) -> str:
        """The given conditions in words, without ids and networks, because these are erased."""
        parts = []
        if self.installations:
            parts.append(f"{len(self.installations)} chosen installations")
        if self.network:
            parts.append("one network")
        if self.device:
            parts.append(f"device {self.device}")
        if self.since:
            parts.append(f"received from {self.since.isoformat()}")
        if self.until:
            parts.append(f"received before {self.until.isoformat()}")
        return ", ".join(parts)

    def find_installations(self) -> QuerySet[Installation]:
        """The installations that meet the conditions on installations; none without such conditions."""
        wanted = Q()
        if self.installations:
            wanted &= Q(pk__in=self.installations)
        if self.network:
            wanted &= Q(network=self.network)
        return Installation.objects.filter(wanted) if wanted else Installation.objects.none()

    def find_sessions(self) -> QuerySet[MeasurementSession]:
        """The sessions to erase."""
        wanted = Q()
        if self.installations or self.network:
            wanted &= Q(installation__in=self.find_installations().order_by().values("pk"))
        if self.device:
            models = DeviceModel.objects.filter(Q(slug=self.device) | Q(canonical__slug=self.device))
            wanted &= Q(description__model__in=models.order_by().values("pk"))
        if self.since:
            wanted &= Q(received_at__gte=self.since)
        if self.until:
            wanted &= Q(received_at__lt=self.until)
        return MeasurementSession.objects.filter(wanted)


@dataclass(frozen=True)
class Preview:
    """What an erasure would delete. `models` and `figures` name the first MAX_LISTED."""

    installations: int
    whole_installations: int
    sessions: int
    runs: int
    model_count: int
    models: list[str]
    figure_count: int
    figures: list[str]

    @property
    def empty(self) -> bool:
        """Whether nothing would be erased."""
        return not (self.sessions or self.whole_installations)


def preview(selection: Selection) -> Preview:
    """What `erase` would delete now, with the models and figures that would change."""
    sessions = selection.find_sessions().order_by()
    models = DeviceModel.objects.filter(descriptions__sessions__in=sessions).distinct().order_by("slug")
    cohorts = Cohort.objects.filter(summaries__session__in=sessions).distinct().order_by("pk")
    whole = selection.find_installations().count() if selection.of_whole_installations else 0
    return Preview(
        installations=whole or sessions.values("installation").distinct().count(),
        whole_installations=whole,
        sessions=sessions.count(),
        runs=Run.objects.filter(session__in=sessions).count(),
        model_count=models.count(),
        models=[str(model) for model in models[:MAX_LISTED]],
        figure_count=cohorts.count(),
        figures=[_figure_name(cohort) for cohort in cohorts.select_related("device", "front")[:MAX_LISTED]],
    )


def erase(selection: Selection, actor: str, reason: str) -> Preview:
    """Erase what `selection` finds now. Returns what that was.

    Data that arrives meanwhile stays. The tokens of installations that are erased as a whole are revoked
    first, so that nothing arrives from them. The log gets an entry before the first batch and one after the
    last.
    """
    erased = preview(selection)
    counts = f"{erased.installations} installations, {erased.sessions} sessions, {erased.runs} runs"
    note = f"{selection.conditions}; {counts}; {reason}"
    subject = selection.device or selection.conditions
    record(actor, STARTED, subject[:200], note)
    installations = []
    if selection.of_whole_installations:
        installations = list(selection.find_installations().order_by("pk").values_list("pk", flat=True))
        open_ones = selection.find_installations().filter(revoked_at=None)
        open_ones.update(revoked_at=timezone.now())
    sessions = selection.find_sessions().order_by("pk")
    newest = sessions.values_list("pk", flat=True).last() or 0
    left = sessions.filter(pk__lte=newest).values_list("pk", flat=True)
    while keys := list(left[:BATCH]):
        erasure.erase_sessions(keys)
    for key in installations:
        erasure.erase_installation(Installation(pk=key))
    record(actor, FINISHED, subject[:200], note)
    return erased


def _figure_name(cohort: Cohort) -> str:
    parts = (str(cohort.device), cohort.front.slug, cohort.backend, cohort.processor)
    return ", ".join(part for part in parts if part)
