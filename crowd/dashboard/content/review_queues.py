"""Queues of rows that wait for a review, for the admin index."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any
from urllib.parse import urlencode

from django.db.models import QuerySet
from django.urls import reverse

from crowd.devices.models import DeviceAlias, DeviceModel
from crowd.explorations.models import Exploration
from crowd.fronts.models import FrontVersion
from crowd.results.models import MeasurementSession, SessionSummary, State

RECENT = timedelta(days=30)
# Counting stops here, so that the index does not read tables of a million rows.
MOST = 1000


@dataclass(frozen=True)
class Queue:
    """Rows that wait, with the address of the list that shows them. `count` is at most MOST."""

    title: str
    meaning: str
    count: int
    address: str

    @property
    def more(self) -> bool:
        return self.count >= MOST


@dataclass(frozen=True)
class _Kind:
    title: str
    meaning: str
    rows: Callable[[], QuerySet[Any]]
    query: dict[str, str]


def waiting(may: Callable[[str], bool], now: datetime) -> tuple[Queue, ...]:
    """The queues that the account may see; `may` checks a permission. One query per queue."""
    queues = []
    for kind in _kinds(now - RECENT):
        rows = kind.rows()
        options = rows.model._meta
        if may(f"{options.app_label}.view_{options.model_name}"):
            address = reverse(f"admin:{options.app_label}_{options.model_name}_changelist")
            count = rows.order_by()[:MOST].count()
            queues.append(Queue(kind.title, kind.meaning, count, f"{address}?{urlencode(kind.query)}"))
    return tuple(queues)


def _kinds(since: datetime) -> tuple[_Kind, ...]:
    recent = SessionSummary.objects.filter(started_at__gte=since)

    def answers(state: State) -> dict[str, Any]:
        return {
            "rows": lambda: recent.filter(state=state),
            "query": {"state__exact": state.value, "started_at__gte": since.isoformat()},
        }

    return (
        _Kind(
            "Quarantined",
            "results of the last 30 days that a rule or a person has hidden",
            **answers(State.QUARANTINED),
        ),
        _Kind(
            "Suspect",
            "results of the last 30 days that only count if a device has no valid ones",
            **answers(State.SUSPECT),
        ),
        _Kind(
            "Proposed aliases",
            "two names that may be one device: accept or refuse",
            lambda: DeviceAlias.objects.filter(state=DeviceAlias.State.PROPOSED),
            {"state__exact": DeviceAlias.State.PROPOSED.value},
        ),
        _Kind(
            "Unknown devices",
            "they do not report their model: mark them as devices, or merge them",
            lambda: DeviceModel.objects.filter(kind=DeviceModel.Kind.UNKNOWN, judged_by=""),
            {"queue": "unknown"},
        ),
        _Kind(
            "Emulators",
            "emulators by the rules, not yet reviewed",
            lambda: DeviceModel.objects.filter(kind=DeviceModel.Kind.EMULATOR, judged_by=""),
            {"queue": "emulator"},
        ),
        _Kind(
            "Fronts in review",
            "they wait for publication",
            lambda: FrontVersion.objects.filter(state=FrontVersion.State.IN_REVIEW),
            {"state__exact": FrontVersion.State.IN_REVIEW.value},
        ),
        _Kind(
            "Paused explorations",
            "they wait until a person resumes them",
            lambda: Exploration.objects.filter(state=Exploration.State.PAUSED),
            {"state__exact": Exploration.State.PAUSED.value},
        ),
        _Kind(
            "Sessions without a summary",
            "not processed yet; many or old ones mean that no worker runs",
            lambda: MeasurementSession.objects.filter(summary_algorithm=None),
            {"summary_algorithm__isempty": "1"},
        ),
    )
