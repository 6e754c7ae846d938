"""Schemas of the responses about sessions and runs."""

import msgspec
import numpy as np
from numpy.typing import NDArray

from crowd.records.record import answer, fill
from crowd.records.run import OF_SESSION, RunRow
from crowd.records.session import SessionRow, SessionSpeedup
from crowd.results.reading.rows import RunSeries, SessionDetail


class SpeedupOfSession(answer(SessionSpeedup)):  # type: ignore[misc]
    """A session's speedup of a configuration with its interval; null without a valid pair of runs."""


class SessionAnswer(answer(SessionRow)):  # type: ignore[misc]
    """A session. Times of day are rounded down to the hour. `summarised`: its speedups are computed."""

    speedups: list[SpeedupOfSession]


class SessionPage(msgspec.Struct):
    """Sessions, newest first."""

    results: list[SessionAnswer]
    next: str | None


class SampleAnswer(msgspec.Struct):
    """The state of the device `t` seconds after the start; null if the platform hides it.

    `battery` is 0 to 1.
    """

    t: float
    temperature_c: float | None
    cpu_mhz: float | None
    battery: float | None


class RunAnswer(answer(RunRow)):  # type: ignore[misc]
    """A run in a list of runs of many sessions. `reason` says why its `state` is not valid."""


class RunPage(msgspec.Struct):
    """Runs: newest session first, and in each its newest run first."""

    results: list[RunAnswer]
    next: str | None


class RunWithFrames(answer(RunRow, without=OF_SESSION)):  # type: ignore[misc]
    """A run of a configuration with its frames. `reason` says why its `state` is not valid."""

    frame_us: list[int]
    stages_us: dict[str, list[int]]
    tracked: list[bool | None]


class SessionDetailAnswer(SessionAnswer):
    """A session with its runs and samples. Times of day are rounded down to the hour.

    `driver`: the driver, or the browser, with its version.
    """

    driver: str
    samples: list[SampleAnswer]
    runs: list[RunWithFrames]


def session(row: SessionRow) -> SessionAnswer:
    """A session as JSON."""
    return fill(SessionAnswer, row, speedups=[fill(SpeedupOfSession, each) for each in row.speedups])


def session_detail(row: SessionDetail) -> SessionDetailAnswer:
    """A session with its runs and samples as JSON."""
    return SessionDetailAnswer(
        **msgspec.structs.asdict(session(row.session)),
        driver=row.driver,
        # Unknown members of a sample are only shown to its owner.
        samples=[
            msgspec.convert({name: sample.get(name) for name in SampleAnswer.__struct_fields__}, SampleAnswer)
            for sample in row.samples
        ],
        runs=[_run_with_frames(run) for run in row.runs],
    )


def run(row: RunRow) -> RunAnswer:
    """A run in a list as JSON."""
    return fill(RunAnswer, row)


def _run_with_frames(row: RunSeries) -> RunWithFrames:
    return fill(
        RunWithFrames,
        row.run,
        frame_us=_microseconds(row.frame_seconds),
        stages_us={name: _microseconds(series) for name, series in row.stage_seconds.items()},
        tracked=list(row.tracked),
    )


def _microseconds(seconds: NDArray[np.float64]) -> list[int]:
    return [round(microseconds) for microseconds in (seconds * 1e6).tolist()]
