"""Erasure by an administrator: everything of chosen installations, a network, a device model or a period.

It works in batches, each a complete erasure of its own. Interrupted, it can be started again with the same
selection: what is left is found and erased.
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

# Sessions of one transaction: other writers wait for a second at most.
BATCH = 200
SHOWN = 100
STARTED, FINISHED = "measurements: erasing", "measurements: erased"


@dataclass(frozen=True)
class Selection:
    """What to erase: all conditions that are set must hold. `until` is not included.

    Without a device and a period whole installations are erased, otherwise sessions alone. Raises ValueError
    where nothing is selected.
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
        """Whether the installations themselves are erased, with their tokens."""
        return not (self.device or self.since or self.until)

    @property
    def conditions(self) -> str:
        """Which conditions are set. Ids and networks are left out, because they are erased."""
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
        """The installations that fulfil the conditions on installations; none where there are none."""
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
    """What an erasure would delete; `models` and `figures` list the first SHOWN, by name."""

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
        """Whether there is nothing to erase."""
        return not (self.sessions or self.whole_installations)


def preview(selection: Selection) -> Preview:
    """Count what `erase` would delete now, and name the models and figures that would change."""
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
        models=[str(model) for model in models[:SHOWN]],
        figure_count=cohorts.count(),
        figures=[_name(cohort) for cohort in cohorts.select_related("device", "front")[:SHOWN]],
    )


def erase(selection: Selection, actor: str, reason: str) -> Preview:
    """Erase what SELECTION finds now; how much that was. What arrives meanwhile stays, except that nothing
    more can arrive from installations that are erased as a whole: their tokens are revoked first.

    The log gets two entries: before the first batch and after the last one.
    """
    found = preview(selection)
    counts = f"{found.installations} installations, {found.sessions} sessions, {found.runs} runs"
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
    return found


def _name(cohort: Cohort) -> str:
    parts = (str(cohort.device), cohort.front.slug, cohort.backend, cohort.processor)
    return ", ".join(part for part in parts if part)
