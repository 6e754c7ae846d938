"""Reads of results: what pages and the API show. Every figure comes from summaries, never from raw times."""

import json
from collections import defaultdict
from collections.abc import Iterable
from datetime import UTC, datetime, time
from typing import Any
from uuid import UUID

from django.db.models import Exists, F, OuterRef, Prefetch, Q, QuerySet

from crowd.devices import names
from crowd.devices.models import DeviceDescription, DeviceModel, Installation
from crowd.fronts.models import FrontVersion
from crowd.fronts.selectors import BEST
from crowd.results import packing, statistics, summaries
from crowd.results.filters import ALL, SpeedupFilters
from crowd.results.intake import REJECTED
from crowd.results.models import (
    Cohort,
    DeviceActivity,
    DeviceSpeedup,
    MeasurementSession,
    Run,
    SessionSummary,
    State,
    Submission,
)
from crowd.results.rows import (
    Device,
    DeviceDetail,
    DeviceRow,
    Headline,
    RunDetail,
    RunRow,
    RunSeries,
    SessionDetail,
    SessionRow,
    SessionSpeedup,
    Speedup,
    Speedups,
    SubmissionRow,
)

LISTED_SESSIONS = 20
LISTED_DESCRIPTIONS = 20
DEVICE = ("slug", "manufacturer", "name", "market_name", "cpu", "soc", "gpu", "os", "kind")
FIGURE = (
    "backend", "processor", "speedup", "low", "high", "repeat_low", "repeat_high", "sessions",
    "installations", "ate_max",
)  # fmt: skip


def measured_front(application: str) -> str | None:
    """Slug of the newest published front that is measured; the newest of all before anyone measured."""
    published = FrontVersion.objects.filter(application=application, state=FrontVersion.State.PUBLISHED)
    measured = published.filter(pk__in=DeviceSpeedup.objects.values("front_id"))
    return measured.values_list("slug", flat=True).first() or published.values_list("slug", flat=True).first()


def speedups(filters: SpeedupFilters) -> Speedups:
    """Bars and headline for FILTERS, fastest first. Four queries at most, whatever the number of devices."""
    front = filters.front or measured_front(filters.application)
    rows = _speedups_since(filters, front) if filters.since else _stored_speedups(filters, front)
    ordered = tuple(sorted(rows, key=lambda row: (-row.speedup, row.device.slug, row.configuration)))
    return Speedups(filters, front, ordered, headline(ordered, filters.configuration))


def headline(rows: Iterable[Speedup], configuration: str = BEST) -> Headline:
    """The crowd's figure over device models; a model measured on several processors counts once.

    The models of which no valid figure exists count only where there is none of any model.
    """
    name = BEST if configuration == ALL else configuration
    shown = [row for row in rows if row.configuration == name]
    counted = [row for row in shown if not row.suspect] or shown
    by_model: dict[str, list[float]] = defaultdict(list)
    for row in counted:
        by_model[row.device.slug].append(row.speedup)
    models = [statistics.geometric_mean(values) for values in by_model.values()]
    crowd = statistics.crowd_speedup(models)
    return Headline(
        devices=len(models),
        sessions=sum(row.sessions for row in counted),
        geometric_mean=crowd.value if crowd else None,
        low=crowd.low if crowd else None,
        high=crowd.high if crowd else None,
        min=min(models, default=None),
        max=max(models, default=None),
        suspect=bool(counted) and counted[0].suspect,
    )


def devices() -> tuple[DeviceRow, ...]:
    """Every device with a summarised session, fastest first, those without a figure last. Five queries."""
    best = {row.device.slug: row for row in reversed(speedups(SpeedupFilters()).rows)}
    counts = DeviceActivity.objects.values_list("device_id", "sessions", "installations", "last_session_at")
    models = {model.pk: model for model in DeviceModel.objects.filter(activity__isnull=False)}
    rows = (
        DeviceRow(_device(model), sessions, installations, _hour(last), best.get(model.slug))
        for key, sessions, installations, last in counts
        if (model := models.get(key)) is not None
    )
    return tuple(
        sorted(rows, key=lambda row: (-(row.speedup.speedup if row.speedup else 0.0), row.device.slug))
    )


def device(slug: str) -> DeviceDetail | None:
    """One device: every configuration, newest front first; newest sessions.

    None for an unknown SLUG, and for a model of which nothing is shown under its own name.
    """
    model = DeviceModel.objects.filter(slug=slug).first()
    if model is None:
        return None
    sessions = _sessions().filter(device=model)
    listed = tuple(sessions[:LISTED_SESSIONS])
    if not listed:
        return None
    speedups = DeviceSpeedup.objects.filter(device=model).order_by("-front__published_at", "-speedup")
    activity = DeviceActivity.objects.filter(device=model).first()
    return DeviceDetail(
        device=_device(model),
        speedups=tuple(_figures(speedups)),
        sessions=tuple(_session(row) for row in listed),
        # Before the first summary of a device nothing has counted its sessions.
        session_count=activity.sessions if activity else len(listed),
        installations=activity.installations if activity else 0,
        descriptions=_descriptions(model),
        latest=_detail(listed[0]),
    )


def latest_sessions(limit: int = LISTED_SESSIONS) -> tuple[SessionRow, ...]:
    """The sessions that arrived last, newest first. Two queries."""
    return tuple(_session(row) for row in _sessions()[:limit])


def own_sessions(installation: Installation, model: DeviceModel, limit: int) -> tuple[SessionRow, ...]:
    """The sessions of INSTALLATION on MODEL, or on an alias of it, newest first. Two queries."""
    own = Q(description__model=model) | Q(description__model__canonical=model)
    return tuple(_session(row) for row in _sessions().filter(own, installation=installation)[:limit])


def session(uuid: UUID) -> SessionDetail | None:
    """A session with the series of all its runs; None if unknown. Three queries."""
    row = _sessions().filter(uuid=uuid).first()
    return None if row is None else _detail(row)


def run(uuid: UUID) -> RunDetail | None:
    """One run's page; None if unknown. Three queries."""
    row = Run.objects.select_related("configuration").filter(uuid=uuid).first()
    if row is None:
        return None
    around = _sessions().get(pk=row.session_id)
    return RunDetail(
        run=_series(row),
        session=_session(around),
        protocol=around.front.protocol,
        platform=around.platform,
        driver=around.driver,
        parameters=row.configuration.parameters,
    )


def submission(installation: Installation, key: UUID) -> SubmissionRow | None:
    """What became of the submission KEY that INSTALLATION sent; None if it sent none such. Three queries."""
    row = Submission.objects.filter(installation=installation, pk=key).first()
    if row is None:
        return None
    # A session that came in parts belongs to the submission of its first run: the runs' ids find it too.
    items = json.loads(row.answer)["items"]
    uuids = [item["id"] for item in items if item["status"] != REJECTED]
    sessions = (
        _sessions().filter(Q(submission=row) | Q(runs__uuid__in=uuids, installation=installation)).distinct()
    )
    return SubmissionRow(
        id=row.pk,
        received_at=row.received_at,
        items=items,
        sessions=tuple(_session(each) for each in sessions),
    )


def _descriptions(model: DeviceModel) -> tuple[dict[str, object], ...]:
    """Raw strings of MODEL's newest descriptions, of those that have a session under its name."""
    public = MeasurementSession.objects.filter(description=OuterRef("pk"), device=model)
    rows = DeviceDescription.objects.filter(Q(model=model) | Q(model__canonical=model)).filter(Exists(public))
    newest = rows.order_by("-first_seen_at")[:LISTED_DESCRIPTIONS]
    return tuple(newest.values_list("raw", flat=True))


def _hour(moment: datetime) -> datetime:
    return moment.replace(minute=0, second=0, microsecond=0)


def _device(model: DeviceModel) -> Device:
    return Device(
        slug=model.slug,
        manufacturer=model.manufacturer,
        name=model.shown_name,
        cpu=model.cpu,
        soc=model.soc,
        gpu=model.gpu,
        os=model.os,
        kind=model.kind,
    )


def _device_restrictions(filters: SpeedupFilters, prefix: str) -> dict[str, str]:
    texts = {"soc": filters.soc, "gpu": filters.gpu, "os": filters.os}
    return {f"{prefix}{name}__icontains": text for name, text in texts.items() if text}


def _stored_speedups(filters: SpeedupFilters, front: str | None) -> list[Speedup]:
    rows = DeviceSpeedup.objects.filter(
        front__slug=front, sessions__gte=filters.min_sessions, **_device_restrictions(filters, "device__")
    )
    if filters.configuration != ALL:
        rows = rows.filter(configuration__name=filters.configuration)
    if filters.backend:
        rows = rows.filter(backend=filters.backend)
    return _figures(rows)


def _speedups_since(filters: SpeedupFilters, front: str | None) -> list[Speedup]:
    """The same figures from the sessions of a period alone, which no stored row holds. Four queries."""
    assert filters.since is not None
    cohorts = Cohort.objects.filter(front__slug=front, **_device_restrictions(filters, "device__"))
    if filters.backend:
        cohorts = cohorts.filter(backend=filters.backend)
    found = {cohort.pk: cohort for cohort in cohorts.select_related("device")}
    rows = SessionSummary.objects.filter(
        cohort__in=cohorts.values("pk"), started_at__gte=datetime.combine(filters.since, time.min, UTC)
    )
    if filters.configuration != ALL:
        rows = rows.filter(configuration__name=filters.configuration)
    version = FrontVersion.objects.filter(slug=front).prefetch_related("configurations").first()
    called = {c.pk: c.name for c in version.configurations.all()} if version else {}
    return [
        Speedup(
            device=_device(found[key.cohort].device),
            front=front or "",
            configuration=called[key.configuration],
            baseline=called[key.baseline],
            backend=found[key.cohort].backend,
            processor=found[key.cohort].processor,
            **figure.numbers,
            last_session_at=_hour(figure.last_session_at),
            suspect=figure.state == State.SUSPECT,
        )
        for key, figure in summaries.figures(rows).items()
        if figure.model.sessions >= filters.min_sessions
    ]


def _figures(rows: QuerySet[DeviceSpeedup]) -> list[Speedup]:
    """ROWS in their order. One query, of the columns that are shown: fronts and configurations are large."""
    found = rows.values(
        *FIGURE,
        "device_id",
        "last_session_at",
        "state",
        *(f"device__{name}" for name in DEVICE),
        front_name=F("front__slug"),
        configuration_name=F("configuration__name"),
        baseline_name=F("baseline__name"),
    )
    devices: dict[int, Device] = {}
    for row in found:
        if row["device_id"] not in devices:
            parts = {name: row[f"device__{name}"] for name in DEVICE}
            parts["name"] = names.shown(parts["manufacturer"], parts["name"], parts.pop("market_name"))
            devices[row["device_id"]] = Device(**parts)
    return [
        Speedup(
            device=devices[row["device_id"]],
            front=row["front_name"],
            configuration=row["configuration_name"],
            baseline=row["baseline_name"],
            last_session_at=_hour(row["last_session_at"]),
            suspect=row["state"] == State.SUSPECT,
            **{name: row[name] for name in FIGURE},
        )
        for row in found
    ]


def _sessions() -> QuerySet[MeasurementSession]:
    answers = SessionSummary.objects.select_related("configuration", "baseline").order_by(
        "configuration__position"
    )
    return MeasurementSession.objects.select_related("device", "front").prefetch_related(
        Prefetch("summaries", queryset=answers)
    )


def _session(row: MeasurementSession) -> SessionRow:
    return SessionRow(
        uuid=row.uuid,
        device=_device(row.device),
        front=row.front.slug,
        backend=row.backend,
        processor=row.processor,
        started_at=_hour(row.started_at),
        summarised=row.summary_algorithm is not None,
        speedups=tuple(_session_speedup(answer) for answer in row.summaries.all()),
    )


def _session_speedup(row: SessionSummary) -> SessionSpeedup:
    return SessionSpeedup(
        configuration=row.configuration.name,
        baseline=row.baseline.name,
        speedup=None if row.log_ratio is None else statistics.ratio(row.log_ratio),
        pairs=row.pairs,
        drift=row.drift,
        ate_max=row.ate_max,
        state=row.state,
        reason=row.reason,
    )


def _detail(row: MeasurementSession) -> SessionDetail:
    runs: Iterable[Any] = row.runs.select_related("configuration").order_by("order")
    return SessionDetail(
        session=_session(row),
        protocol=row.front.protocol,
        platform=row.platform,
        driver=row.driver,
        samples=row.samples,
        runs=tuple(_series(each) for each in runs),
    )


def _series(row: Run) -> RunSeries:
    return RunSeries(
        run=_run(row),
        frame_seconds=packing.seconds(packing.unpack(row.frame_us)),
        stage_seconds={
            name: packing.seconds(series)
            for name, series in packing.unpack_stages(row.stages, row.stages_us).items()
        },
        tracked=tuple(packing.unpack_tracked(row.tracked)),
    )


def _run(row: Run) -> RunRow:
    return RunRow(
        uuid=row.uuid,
        configuration=row.configuration.name,
        repeat=row.repeat,
        order=row.order,
        status=row.status,
        failure=row.failure,
        mean_seconds=None if row.mean_us is None else row.mean_us * 1e-6,
        tracked_frames=row.tracked_frames,
        ate_max=row.ate_max,
        ate_mean=row.ate_mean,
        ate_rmse=row.ate_rmse,
        state=row.state,
        reason=row.reason,
    )
