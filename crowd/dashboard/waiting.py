"""What waits for a person: the administration's overview, with the list behind each count."""

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
from crowd.results.reading.public_rows import simulated_only

RECENT = timedelta(days=30)
# More are not counted: a table of a million rows is not read for a front page.
MOST = 1000
# The list's filter that leaves out what is simulated: nobody has to look at it.
MEASURED = {"simulated": "0"}


@dataclass(frozen=True)
class Queue:
    """Rows that wait, and the list that shows exactly these; count stops at MOST."""

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
    """Every queue whose list the account may see; MAY answers for a permission. One query a queue."""
    found = []
    for kind in _kinds(now - RECENT):
        rows = kind.rows()
        options = rows.model._meta
        if may(f"{options.app_label}.view_{options.model_name}"):
            address = reverse(f"admin:{options.app_label}_{options.model_name}_changelist")
            count = rows.order_by()[:MOST].count()
            found.append(Queue(kind.title, kind.meaning, count, f"{address}?{urlencode(kind.query)}"))
    return tuple(found)


def _kinds(since: datetime) -> tuple[_Kind, ...]:
    measured = simulated_only(False, "session__device__")
    recent = SessionSummary.objects.filter(measured, started_at__gte=since)

    def answers(state: State) -> dict[str, Any]:
        return {
            "rows": lambda: recent.filter(state=state),
            "query": {"state__exact": state.value, "started_at__gte": since.isoformat()} | MEASURED,
        }

    return (
        _Kind(
            "Quarantined",
            "answers of the last 30 days that are hidden: by a rule, or by hand",
            **answers(State.QUARANTINED),
        ),
        _Kind(
            "Suspect",
            "answers of the last 30 days that count only where a device has no valid ones",
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
            "what they say of themselves names no model: mark them as devices, or merge them into one",
            lambda: DeviceModel.objects.filter(kind=DeviceModel.Kind.UNKNOWN, judged_by=""),
            {"queue": "unknown"},
        ),
        _Kind(
            "Emulators",
            "taken for emulators by the rules, and looked at by nobody",
            lambda: DeviceModel.objects.filter(kind=DeviceModel.Kind.EMULATOR, judged_by=""),
            {"queue": "emulator"},
        ),
        _Kind(
            "Fronts in review",
            "somebody asks for their publication",
            lambda: FrontVersion.objects.filter(state=FrontVersion.State.IN_REVIEW),
            {"state__exact": FrontVersion.State.IN_REVIEW.value},
        ),
        _Kind(
            "Paused explorations",
            "they go on when somebody resumes them",
            lambda: Exploration.objects.filter(state=Exploration.State.PAUSED),
            {"state__exact": Exploration.State.PAUSED.value},
        ),
        _Kind(
            "Sessions without a summary",
            "arrived and not worked through yet; many, or old ones, mean that no worker runs",
            lambda: MeasurementSession.objects.filter(simulated_only(False), summary_algorithm=None),
            {"summary_algorithm__isempty": "1"} | MEASURED,
        ),
    )
