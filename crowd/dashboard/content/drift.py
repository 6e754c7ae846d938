"""Changes of a device's speed over a session, and the readings of its sensors."""

from collections.abc import Sequence
from dataclasses import dataclass

from crowd.results.reading.rows import RunSeries, SessionDetail

# Members of a sample: the name for people, and the unit.
SENSORS = {
    "temperature_c": ("temperature", "°C"),
    "cpu_mhz": ("processor clock", "MHz"),
    "battery": ("battery", "%"),
}


@dataclass(frozen=True)
class Step:
    """A run at its place (from 1). `ratio`: its time over that of the first run of its configuration.

    It compares the means of the frames that both have; 1.0 for the first run itself.
    """

    place: int
    configuration: str
    repeat: int
    ratio: float


@dataclass(frozen=True)
class Readings:
    """At least two readings of a sensor: seconds after the start, and values in its unit."""

    name: str
    unit: str
    seconds: tuple[float, ...]
    values: tuple[float, ...]


def steps(session: SessionDetail) -> tuple[Step, ...]:
    """The finished runs of `session` in order, without those that have no counted frames."""
    counted_from = session.protocol.first_counted_frame
    first: dict[str, RunSeries] = {}
    finished = []
    for series in session.runs:
        if not series.run.finished or not (series.frame_seconds[counted_from:] > 0).any():
            continue
        reference = first.setdefault(series.run.configuration, series)
        counted = slice(counted_from, min(reference.frame_seconds.size, series.frame_seconds.size))
        ratio = float(series.frame_seconds[counted].mean() / reference.frame_seconds[counted].mean())
        finished.append(Step(series.run.order + 1, series.run.configuration, series.run.repeat, ratio))
    return tuple(finished)


def readings(samples: Sequence[dict[str, object]]) -> tuple[Readings, ...]:
    """The readings of SENSORS in `samples`, without sensors that have fewer than two."""
    series = []
    for key, (name, unit) in SENSORS.items():
        values = [
            (float(t), float(value))
            for sample in samples
            if isinstance(t := sample.get("t"), int | float)
            and isinstance(value := sample.get(key), int | float)
        ]
        if len(values) > 1:
            moments, readings_of = zip(*sorted(values), strict=True)
            series.append(Readings(name, unit, moments, readings_of))
    return tuple(series)
