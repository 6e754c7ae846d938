"""One device: its configurations, its place in the crowd, its history, how it held out over a session."""

from dataclasses import dataclass
from uuid import UUID

from django.http import HttpRequest
from django.urls import reverse

from crowd.dashboard import drift, formats
from crowd.dashboard.answering import found
from crowd.dashboard.choosing import Measured, measured
from crowd.dashboard.drawings.drawing import Drawing, Table
from crowd.dashboard.drawings.sessions import read_session
from crowd.dashboard.figures.devices import (
    configuration_bars,
    crowd_bars,
    drift_steps,
    release_marks,
    sensor_lines,
)
from crowd.dashboard.points import newest_figure
from crowd.dashboard.standing import Standing, standing
from crowd.results.reading import selectors as results
from crowd.results.reading.filters import SpeedupFilters
from crowd.results.reading.rows import Device, DeviceDetail, History, Place, SessionDetail, Speedup


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


def place_of(detail: DeviceDetail, figure: Speedup | None) -> Place | None:
    """Where the device stands among those that measured the front of FIGURE; simulated ones among their
    like.
    """
    if figure is None:
        return None
    crowd = results.speedups(SpeedupFilters(front=figure.front, simulated=detail.device.simulated))
    return results.place(crowd.rows, detail.device.slug)


def read_configurations(request: HttpRequest, slug: str) -> Configurations:
    detail = _measured(request, slug).detail
    return Configurations(detail.device, found(standing(detail, newest_figure(detail))))


def read_place(request: HttpRequest, slug: str) -> Place:
    detail = _measured(request, slug).detail
    return found(place_of(detail, newest_figure(detail)))


def read_history(request: HttpRequest, slug: str) -> Past:
    shown = _measured(request, slug)
    return Past(shown.detail.device, found(results.history(slug, application=shown.application)))


def _measured(request: HttpRequest, slug: str) -> Measured:
    return measured(slug, request.GET.get("application", ""))


def configurations_table(shown: Configurations) -> Table:
    """A row for each configuration, fastest first."""
    return Table(
        (
            "configuration", "front", "backend", "processor", "speedup", "low", "high", "sessions",
            "installations", "ate_max_m", "state",
        ),
        [
            (
                row.configuration, row.front, row.backend, row.processor, row.speedup, row.low, row.high,
                row.sessions, row.installations, row.ate_max, "suspect" if row.suspect else "valid",
            )
            for row in shown.standing.rows
        ],
    )  # fmt: skip


def place_table(place: Place) -> Table:
    """A row for each device model, fastest first."""
    return Table(
        ("rank", "device", "speedup", "this"),
        [
            (rank, device.slug, speedup, device.slug == place.device.slug)
            for rank, (device, speedup) in enumerate(place.models, 1)
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


def _device_page(slug: str) -> str:
    return reverse("dashboard:device", args=[slug])


def _session_page(uuid: UUID) -> str:
    return reverse("dashboard:session", args=[uuid])


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
        "95 % interval over installations, from three of them on.",
        read=read_configurations,
        draw=lambda shown, theme: configuration_bars(shown.standing.rows, theme),
        table=configurations_table,
        title=lambda shown: f"Every configuration on {shown.device.title}",
        n=lambda shown: formats.plural(len(shown.standing.rows), "configuration"),
        page=_device_page,
        simulated=lambda shown: shown.device.simulated,
    ),
    Drawing(
        name="device-place",
        path="devices/<slug:slug>/crowd",
        definition="Speedup of best over default on each device model that measured the same front, each "
        "counted once.",
        read=read_place,
        draw=crowd_bars,
        table=place_table,
        title=lambda place: f"{place.device.title} and the crowd",
        n=lambda place: formats.plural(len(place.models), "device model"),
        page=_device_page,
        simulated=lambda place: place.device.simulated,
    ),
    Drawing(
        name="device-history",
        path="devices/<slug:slug>/history",
        definition="Speedup of best over default under each driver and version of the system: installations "
        "weigh the same. Whiskers: 95 % interval over installations, from three of them on.",
        read=read_history,
        draw=lambda past, theme: release_marks(past.history.releases, theme),
        table=history_table,
        title=lambda past: f"{past.device.title} by driver and system",
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
        n=lambda session: f"{formats.plural(len(drift.steps(session)), 'run')} of one session",
        page=_session_page,
        simulated=lambda session: session.session.device.simulated,
    ),
    Drawing(
        name="session-sensors",
        path="sessions/<uuid:uuid>/sensors",
        definition="What the device told of its state between frames, at most once a second.",
        read=read_session,
        draw=lambda session, theme: sensor_lines(drift.readings(session.samples), theme),
        table=sensors_table,
        title=lambda session: f"Temperature and clock over a session on {session.session.device.title}",
        n=lambda session: formats.plural(len(session.samples), "sample"),
        page=_session_page,
        simulated=lambda session: session.session.device.simulated,
    ),
)
