"""Charts of one device: configurations, place in the crowd, history, drift over a session."""

from dataclasses import dataclass, replace
from uuid import UUID

from django.http import HttpRequest
from django.urls import reverse
from msgspec import structs

from crowd.dashboard import formats
from crowd.dashboard.comparing.application_choice import MeasuredDevice, measured_device
from crowd.dashboard.content import drift
from crowd.dashboard.content.confirmation import confirmed_only
from crowd.dashboard.content.points import newest_figure
from crowd.dashboard.content.ranking import ConfigurationRanking, rank_configurations
from crowd.dashboard.drawings.drawing import Drawing, Table
from crowd.dashboard.drawings.sessions import read_session
from crowd.dashboard.figures import findings
from crowd.dashboard.figures.devices import (
    configuration_bars,
    crowd_bars,
    drift_steps,
    release_marks,
    sensor_lines,
)
from crowd.dashboard.responses import or_404
from crowd.records.device import Device
from crowd.records.speedup import Speedup
from crowd.results.reading import selectors as results
from crowd.results.reading.queries.filters import SpeedupFilters
from crowd.results.reading.rows import DeviceDetail, History, Ranking, SessionDetail
from crowd.results.reading.selectors import Speedups
from wire.front import BEST


@dataclass(frozen=True)
class Configurations:
    """A device with the ranking of the front's configurations."""

    device: Device
    ranking: ConfigurationRanking


@dataclass(frozen=True)
class DeviceHistory:
    """A device with its speedups by driver and system."""

    device: Device
    history: History


@dataclass(frozen=True)
class Rank:
    """The place of a device among the models with a confirmed figure.

    If not `confirmed`, `place` is the place that it would have.
    """

    place: Ranking
    confirmed: bool


def crowd_of(detail: DeviceDetail, figure: Speedup | None) -> Speedups:
    """The crowd to compare a device with: on the front of `figure`, otherwise of its newest session."""
    front = figure.front if figure else or_404(detail.latest).session.front
    return results.speedups(SpeedupFilters(front=front))


def rank_of(crowd: Speedups, slug: str) -> Rank | None:
    """The rank of the device `slug` in `crowd`; None if its figure is missing or suspect."""
    ranking = crowd.ranking(slug)
    if ranking is not None:
        return Rank(ranking, confirmed=True)
    rows = tuple(
        structs.replace(row, confirmed=True) if row.device.slug == slug else row for row in crowd.rows
    )
    ranking = replace(crowd, rows=rows).ranking(slug)
    return None if ranking is None else Rank(ranking, confirmed=False)


def attempts_of(crowd: Speedups, slug: str, figure: Speedup | None) -> tuple[int, int, int]:
    """The numbers of sessions of the device `slug` in which `best` ran, did not finish, and lost tracking.

    Only on the processor of `figure`, if given.
    """
    counts = [
        row.counts
        for row in crowd.outcomes
        if row.device.slug == slug
        and row.configuration == BEST
        and (figure is None or (row.backend, row.processor) == (figure.backend, figure.processor))
    ]
    return (
        sum(one.sessions for one in counts),
        sum(one.failed for one in counts),
        sum(one.lost for one in counts),
    )


def read_configurations(request: HttpRequest, slug: str) -> Configurations:
    detail = _measured(request, slug).detail
    return Configurations(detail.device, or_404(rank_configurations(detail, newest_figure(detail))))


def read_place(request: HttpRequest, slug: str) -> Rank:
    detail = _measured(request, slug).detail
    return or_404(rank_of(crowd_of(detail, newest_figure(detail)), slug))


def read_history(request: HttpRequest, slug: str) -> DeviceHistory:
    shown = _measured(request, slug)
    return DeviceHistory(shown.detail.device, or_404(results.history(slug, application=shown.application)))


def _measured(request: HttpRequest, slug: str) -> MeasuredDevice:
    return measured_device(slug, request.GET.get("application", ""))


def configurations_table(shown: Configurations) -> Table:
    """A row per configuration, fastest first."""
    return Table.of(
        shown.ranking.rows, "configuration", "front", "backend", "processor", "processor_class", "speedup",
        "low", "high", "session_low", "session_high", "sessions", "installations", "ate_max_m=ate_max",
        "state", "suspect",
    )  # fmt: skip


def place_table(rank: Rank) -> Table:
    """A row per device model, fastest first."""
    slug = rank.place.device.slug
    return Table(
        ("rank", "device", "speedup", "this", "state"),
        [
            (
                number,
                device.slug,
                speedup,
                device.slug == slug,
                "confirmed" if rank.confirmed or device.slug != slug else "unconfirmed",
            )
            for number, (device, speedup) in enumerate(rank.place.models, 1)
        ],
    )


def history_table(past: DeviceHistory) -> Table:
    """A row per driver and system version, in order of first appearance."""
    return Table.of(
        past.history.releases, "driver", "os_version", "speedup", "low", "high", "sessions", "installations",
        "first_at", "last_at",
    )  # fmt: skip


def drift_table(session: SessionDetail) -> Table:
    """A row per run, in order."""
    return Table.of(drift.steps(session), "place", "configuration", "repeat", "time_over_first_run=ratio")


def sensors_table(session: SessionDetail) -> Table:
    """A row per reading of each sensor."""
    return Table(
        ("sensor", "unit", "t_s", "value"),
        [
            (sensor.name, sensor.unit, seconds, value)
            for sensor in drift.readings(session.samples)
            for seconds, value in zip(sensor.seconds, sensor.values, strict=True)
        ],
    )


def finding_of(here: ConfigurationRanking) -> str:
    """What the bars of a device's configurations show, in one sentence."""
    return findings.configurations(
        here.winner, here.winner_speedup, here.configurations, here.best_rank, here.winner_range
    )


def _device_page(slug: str) -> str:
    return reverse("dashboard:device", args=[slug])


def _session_page(uuid: UUID) -> str:
    return reverse("dashboard:session", args=[uuid])


def _confirmed_configurations(shown: Configurations) -> Configurations:
    rows = confirmed_only(shown.ranking.rows)
    return replace(shown, ranking=replace(shown.ranking, rows=rows))


def _place_title(rank: Rank) -> str:
    state = "" if rank.confirmed else " (unconfirmed)"
    return f"{rank.place.device.title}{state} and the crowd"


def _history_n(past: DeviceHistory) -> str:
    sessions = sum(row.sessions for row in past.history.releases)
    return (
        f"{formats.plural(sessions, 'session')} under {formats.plural(len(past.history.releases), 'release')}"
    )


DRAWINGS = (
    Drawing(
        name="device-configurations",
        path="devices/<slug:slug>/configurations",
        definition="Time of the default configuration over that of each other one, on this device. Whiskers: "
        "95 % interval over independent installations, from three of them on. Dotted: unconfirmed. Striped: "
        "suspect.",
        read=read_configurations,
        draw=lambda shown, theme: configuration_bars(shown.ranking.rows, theme),
        table=configurations_table,
        title=lambda shown: f"Every configuration on {shown.device.title}",
        finding=lambda shown: finding_of(shown.ranking),
        n=lambda shown: formats.plural(len(shown.ranking.rows), "configuration"),
        page=_device_page,
        embedded=_confirmed_configurations,
    ),
    Drawing(
        name="device-place",
        path="devices/<slug:slug>/crowd",
        definition="Speedup of best over default on each device model with a confirmed figure of the same "
        "front, each counted once. An unconfirmed device is shown at the place that it would have.",
        read=read_place,
        draw=lambda rank, theme: crowd_bars(rank.place, theme, rank.confirmed),
        table=place_table,
        title=_place_title,
        finding=lambda rank: findings.place(rank.place, rank.confirmed),
        n=lambda rank: formats.plural(len(rank.place.models), "device model"),
        page=_device_page,
    ),
    Drawing(
        name="device-history",
        path="devices/<slug:slug>/history",
        definition="Speedup of best over default under each driver and version of the system: installations "
        "weigh the same. Whiskers: 95 % interval over independent installations, from three of them on.",
        read=read_history,
        draw=lambda past, theme: release_marks(past.history.releases, theme),
        table=history_table,
        title=lambda past: f"{past.device.title} by driver and system",
        finding=lambda past: findings.releases(past.history),
        n=_history_n,
        page=_device_page,
    ),
    Drawing(
        name="session-drift",
        path="sessions/<uuid:uuid>/drift",
        definition="Mean time a frame of a run over that of the first run of its configuration.",
        read=read_session,
        draw=lambda session, theme: drift_steps(drift.steps(session), theme),
        table=drift_table,
        title=lambda session: f"Drift over a session on {session.session.device.title}",
        finding=lambda session: findings.drift(drift.steps(session)),
        n=lambda session: f"{formats.plural(len(drift.steps(session)), 'run')} of one session",
        page=_session_page,
    ),
    Drawing(
        name="session-sensors",
        path="sessions/<uuid:uuid>/sensors",
        definition="Readings of the device's sensors, at most one per second.",
        read=read_session,
        draw=lambda session, theme: sensor_lines(drift.readings(session.samples), theme),
        table=sensors_table,
        title=lambda session: f"Temperature and clock over a session on {session.session.device.title}",
        finding=lambda session: findings.sensors(drift.readings(session.samples)),
        n=lambda session: formats.plural(len(session.samples), "sample"),
        page=_session_page,
    ),
)
