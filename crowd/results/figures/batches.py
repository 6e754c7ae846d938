"""Many sessions that wait for their summaries, worked on at once: few queries, arrays instead of rows."""

from collections.abc import Collection, Mapping, Sequence
from datetime import UTC, datetime
from typing import NamedTuple
from uuid import UUID

from crowd.devices.models import DeviceDescription, DeviceModel
from crowd.fronts.models import Configuration, FrontVersion
from crowd.fronts.selectors import DEFAULT
from crowd.results.intake.checks import Protocol
from crowd.results.models import MeasurementSession, SessionSummary
from crowd.results.validity.decisions import Decisions
from crowd.results.validity.runs import Front, SessionContext, judge_runs
from crowd.results.validity.sessions import SessionInput, summarise

# device, front, backend, processor: what makes a cohort
Group = tuple[int, int, str, str]
READ = (
    "pk", "installation_id", "device_id", "front_id", "backend", "processor", "started_at", "description_id",
)  # fmt: skip


class Waiting(NamedTuple):
    """The columns READ of a session."""

    key: int
    installation: UUID
    device: int
    front: int
    backend: str
    processor: str
    started_at: datetime
    description: int

    @property
    def group(self) -> Group:
        return self.device, self.front, self.backend, self.processor


def locked(keys: Sequence[int]) -> list[Waiting]:
    """Those of the sessions KEYS that are there, in order, nobody else's until the transaction ends."""
    rows = MeasurementSession.objects.select_for_update().filter(pk__in=keys).order_by("pk")
    return [Waiting(*row) for row in rows.values_list(*READ)]


def summaries(
    sessions: Sequence[Waiting], cohorts: Mapping[int, int], decisions: Decisions
) -> list[SessionSummary]:
    """Judges the runs of SESSIONS, and what follows of them for the cohorts whose keys COHORTS has by the
    session's. The runs' states are stored, the summaries are not. Nine queries at most.
    """
    fronts = _fronts({row.front for row in sessions})
    around = {row.key: SessionContext(row.installation, fronts[row.front]) for row in sessions}
    runs = judge_runs(around, decisions)
    emulators = _emulators({row.description for row in sessions})
    inputs = [
        SessionInput(
            key=row.key,
            cohort=cohorts[row.key],
            installation=row.installation,
            started_at=row.started_at,
            day=row.started_at.astimezone(UTC).date(),
            front=fronts[row.front],
            emulated=row.description in emulators,
            released=decisions.released(row.key),
            plausible={},
        )
        for row in sessions
    ]
    return summarise(inputs, runs, _clocks)


def _fronts(keys: Collection[int]) -> dict[int, Front]:
    protocols = dict(FrontVersion.objects.filter(pk__in=keys).values_list("pk", "protocol"))
    names: dict[int, dict[str, int]] = {key: {} for key in protocols}
    rows = Configuration.objects.filter(front__in=keys).order_by()
    for front, name, configuration in rows.values_list("front_id", "name", "pk"):
        names[front][name] = configuration
    return {
        key: Front(key, Protocol.of(protocol), frozenset(names[key].values()), names[key].get(DEFAULT))
        for key, protocol in protocols.items()
    }


def _clocks(keys: Sequence[int]) -> dict[int, list[float]]:
    """The readings of the processor's clock in the sessions KEYS; samples are large and rarely looked at."""
    rows = MeasurementSession.objects.filter(pk__in=keys).order_by().values_list("pk", "samples")
    return {key: [sample["cpu_mhz"] for sample in samples if sample.get("cpu_mhz")] for key, samples in rows}


def _emulators(descriptions: Collection[int]) -> set[int]:
    """Which of DESCRIPTIONS, keys all, are those of emulators."""
    rows = DeviceDescription.objects.filter(pk__in=descriptions, model__kind=DeviceModel.Kind.EMULATOR)
    return set(rows.values_list("pk", flat=True))
