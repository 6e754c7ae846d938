"""One device: its configurations, its place in the crowd, its history, how it held out over a session."""

from dataclasses import dataclass, replace
from uuid import UUID

from django.http import HttpRequest
from django.urls import reverse

from crowd.dashboard import formats
from crowd.dashboard.answering import found
from crowd.dashboard.comparing.application_choice import Measured, measured
from crowd.dashboard.confirmation import confirmed_only
from crowd.dashboard.content import drift
from crowd.dashboard.content.points import newest_figure
from crowd.dashboard.content.ranking import Standing, standing
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
from crowd.fronts.selectors import BEST
from crowd.results.reading import selectors as results
from crowd.results.reading.queries.filters import SpeedupFilters
from crowd.results.reading.rows import Device, DeviceDetail, History, Ranking, SessionDetail, Speedup
from crowd.results.reading.selectors import Speedups


@dataclass(frozen=True)
class Configurations:
    """A device and how the front's configurations rank on it."""

    device: Device
    standing: Standing


@dataclass(frozen=True)
class Past:
    """A device and how its speedup changed with driver and system."""

    device: Device
    history: History


@dataclass(frozen=True)
class Rank:
    """The place of a device among the device models with a confirmed figure.

    Not `confirmed`: it has no place; `place` is where it would stand once its figure is confirmed.
    """

    place: Ranking
    confirmed: bool


def crowd_of(detail: DeviceDetail, figure: Speedup | None) -> Speedups:
    """The crowd that the device is compared with: on the front of FIGURE, or of its newest session; simulated
    devices among simulated ones.
    """
    front = figure.front if figure else found(detail.latest).session.front
    return results.speedups(SpeedupFilters(front=front, simulated=detail.device.simulated))


def rank_of(crowd: Speedups, slug: str) -> Rank | None:
    """Where the device SLUG stands in CROWD, or would stand; None without a figure and for suspect ones."""
    place = results.ranking(crowd.rows, slug)
    if place is not None:
        return Rank(place, confirmed=True)
    once_confirmed = [replace(row, confirmed=True) if row.device.slug == slug else row for row in crowd.rows]
    place = results.ranking(once_confirmed, slug)
    return None if place is None else Rank(place, confirmed=False)


def attempts_of(crowd: Speedups, slug: str, figure: Speedup | None) -> tuple[int, int, int]:
    """In how many sessions of the device SLUG `best` ran, did not finish, lost the camera; on the processor
    of FIGURE, or on all of them.
    """
    own = [
        row
        for row in crowd.outcomes
        if row.device.slug == slug
        and row.configuration == BEST
        and (figure is None or (row.backend, row.processor) == (figure.backend, figure.processor))
    ]
    return sum(row.sessions for row in own), sum(row.failed for row in own), sum(row.lost for row in own)


def read_configurations(request: HttpRequest, slug: str) -> Configurations:
    detail = _measured(request, slug).detail
    return Configurations(detail.device, found(standing(detail, newest_figure(detail))))


def read_place(request: HttpRequest, slug: str) -> Rank:
    detail = _measured(request, slug).detail
    return found(rank_of(crowd_of(detail, newest_figure(detail)), slug))


def read_history(request: HttpRequest, slug: str) -> Past:
    shown = _measured(request, slug)
    return Past(shown.detail.device, found(results.history(slug, application=shown.application)))


def _measured(request: HttpRequest, slug: str) -> Measured:
    return measured(slug, request.GET.get("application", ""))


def configurations_table(shown: Configurations) -> Table:
    """A row for each configuration, fastest first."""
    return Table(
        (
            "configuration", "front", "backend", "processor", "processor_class", "speedup", "low", "high",
            "session_low", "session_high", "sessions", "installations", "ate_max_m", "state", "suspect",
        ),
        [
            (
                row.configuration, row.front, row.backend, row.processor, row.processor_class, row.speedup,
                row.low, row.high, row.session_low, row.session_high, row.sessions, row.installations,
                row.ate_max, row.state, row.suspect,
            )
            for row in shown.standing.rows
        ],
    )  # fmt: skip


def place_table(rank: Rank) -> Table:
    """A row for each device model, fastest first."""
    own = rank.place.device.slug
    return Table(
        ("rank", "device", "speedup", "this", "state"),
        [
            (
                number,
                device.slug,
                speedup,
                device.slug == own,
                "confirmed" if rank.confirmed or device.slug != own else "unconfirmed",
            )
            for number, (device, speedup) in enumerate(rank.place.models, 1)
        ],
    )


def history_table(past: Past) -> Table:
    """A row for each driver and version of the system, first seen first."""
    return Table(
        (
            "driver", "os_version", "speedup", "low", "high", "sessions", "installations", "first_at",
            "last_at",
        ),
        [
            (
                row.driver, row.os_version, row.speedup, row.low, row.high, row.sessions, row.installations,
                row.first_at.isoformat(), row.last_at.isoformat(),
            )
            for row in past.history.releases
        ],
    )  # fmt: skip


def drift_table(session: SessionDetail) -> Table:
    """A row for each run in its place."""
    return Table(
        ("place", "configuration", "repeat", "time_over_first_run"),
        [(step.place, step.configuration, step.repeat, step.ratio) for step in drift.steps(session)],
    )


def sensors_table(session: SessionDetail) -> Table:
    """A row for each reading of each sensor."""
    return Table(
        ("sensor", "unit", "t_s", "value"),
        [
            (sensor.name, sensor.unit, seconds, value)
            for sensor in drift.readings(session.samples)
            for seconds, value in zip(sensor.seconds, sensor.values, strict=True)
        ],
    )


def finding_of(here: Standing) -> str:
    """What the bars of a device's configurations show, in one sentence."""
    return findings.configurations(here.winner, here.winner_speedup, here.configurations, here.best_rank)


def _device_page(slug: str) -> str:
    return reverse("dashboard:device", args=[slug])


def _session_page(uuid: UUID) -> str:
    return reverse("dashboard:session", args=[uuid])


def _confirmed_configurations(shown: Configurations) -> Configurations:
    rows = confirmed_only(shown.standing.rows)
    return replace(shown, standing=replace(shown.standing, rows=rows))


def _place_title(rank: Rank) -> str:
    state = "" if rank.confirmed else " (unconfirmed)"
    return f"{rank.place.device.title}{state} and the crowd"


def _past_n(past: Past) -> str:
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
        draw=lambda shown, theme: configuration_bars(shown.standing.rows, theme),
        table=configurations_table,
        title=lambda shown: f"Every configuration on {shown.device.title}",
        finding=lambda shown: finding_of(shown.standing),
        n=lambda shown: formats.plural(len(shown.standing.rows), "configuration"),
        page=_device_page,
        embedded=_confirmed_configurations,
        simulated=lambda shown: shown.device.simulated,
    ),
    Drawing(
        name="device-place",
        path="devices/<slug:slug>/crowd",
        definition="Speedup of best over default on each device model with a confirmed figure of the same "
        "front, each counted once. A device whose own figure is unconfirmed is shown where it would stand.",
        read=read_place,
        draw=lambda rank, theme: crowd_bars(rank.place, theme, rank.confirmed),
        table=place_table,
        title=_place_title,
        finding=lambda rank: findings.place(rank.place, rank.confirmed),
        n=lambda rank: formats.plural(len(rank.place.models), "device model"),
        page=_device_page,
        simulated=lambda rank: rank.place.device.simulated,
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
        finding=lambda past: findings.releases(past.history.releases),
        n=_past_n,
        page=_device_page,
        simulated=lambda past: past.device.simulated,
    ),
    Drawing(
        name="session-drift",
        path="sessions/<uuid:uuid>/drift",
        definition="Median over the frames of a run's time over that of the first run of its configuration.",
        read=read_session,
        draw=lambda session, theme: drift_steps(drift.steps(session), theme),
        table=drift_table,
        title=lambda session: f"Drift over a session on {session.session.device.title}",
        finding=lambda session: findings.drift(drift.steps(session)),
        n=lambda session: f"{formats.plural(len(drift.steps(session)), 'run')} of one session",
        page=_session_page,
        simulated=lambda session: session.session.device.simulated,
    ),
    Drawing(
        name="session-sensors",
        path="sessions/<uuid:uuid>/sensors",
        definition="What the device reported of its state between frames, at most once a second.",
        read=read_session,
        draw=lambda session, theme: sensor_lines(drift.readings(session.samples), theme),
        table=sensors_table,
        title=lambda session: f"Temperature and clock over a session on {session.session.device.title}",
        finding=lambda session: findings.sensors(drift.readings(session.samples)),
        n=lambda session: formats.plural(len(session.samples), "sample"),
        page=_session_page,
        simulated=lambda session: session.session.device.simulated,
    ),
)
