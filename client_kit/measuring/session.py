"""A measuring session and its results."""

import math
import uuid
from collections.abc import Mapping
from datetime import UTC, datetime
from statistics import fmean
from typing import Any, cast

import msgspec
import numpy as np

from client_kit.delivery.manifest import Manifest, Protocol
from groundwork import __version__
from wire import session as declared
from wire import session_statistics
from wire.front import DEFAULT
from wire.protocol import NO_STAGES
from wire.session import MAX_SAMPLES, SCHEMA_VERSION, Backend, Submission
from wire.session_statistics import RunTime, Speedup

MICROSECONDS = 1e6


class Run(declared.Run, frozen=True):
    """One configuration over the sequence, with a value a frame in each list.

    `repeat` counts the runs of this configuration in the session, `order` all runs, both from 0. A failed run
    has its reason in `failure`, and times and errors only if it reached the end of the sequence.
    `cpu_us` and `waited_us` are of the counted frames, see `processor_time`.
    """

    stages_us: dict[str, list[int]] = {}
    tracked: list[bool | None] = []

    def deviates(self, asked: Manifest) -> bool:
        """Whether it left the band around its reference trajectory."""
        return self.deviation is not None and self.deviation > asked.by_name[self.configuration].band

    def mean_seconds(self, protocol: Protocol) -> float:
        """The run's value: the arithmetic mean over the frames that count.

        Not the median: a configuration that integrates every 24th frame concentrates that cost in few frames.
        """
        return fmean(self.frame_us[protocol.first_counted_frame :]) / MICROSECONDS

    def slowest_seconds(self, protocol: Protocol) -> tuple[float, float]:
        """The time that 95 of 100 frames that count do not exceed, and that of the slowest."""
        counted = self.frame_us[protocol.first_counted_frame :]
        return float(np.quantile(counted, 0.95)) / MICROSECONDS, max(counted) / MICROSECONDS

    def skipped(self, protocol: Protocol) -> float:
        """The share of the frames that count without tracking."""
        counted = self.tracked[protocol.first_counted_frame :]
        return counted.count(None) / len(counted) if counted else 0.0

    def time(self, protocol: Protocol) -> RunTime:
        """Its times over the frames that count."""
        counted = self.frame_us[protocol.first_counted_frame :]
        return RunTime.of(fmean(counted), len(counted), self.cpu_us, self.waited_us)

    def stage_seconds(self, protocol: Protocol) -> dict[str, float]:
        """Mean seconds a frame of each stage, over the frames that count."""
        first = protocol.first_counted_frame
        return {stage: fmean(series[first:]) / MICROSECONDS for stage, series in self.stages_us.items()}

    def valid(self, asked: Manifest) -> bool:
        """Whether its speed counts: it ran, and its trajectory stayed within the limits."""
        accurate = self.ate_max is not None and self.ate_max < asked.protocol.max_ate
        return self.status == "ok" and accurate and not self.deviates(asked)


class Session(declared.Session, frozen=True):
    """The runs of one session on one device, with samples of its state. `on_processor`: no graphics chip
    computed; the server finds that out by itself."""

    runs: tuple[Run, ...]
    on_processor: bool = False

    def of(self, configuration: str) -> list[Run]:
        """The runs of one configuration, in order."""
        return [run for run in self.runs if run.configuration == configuration]

    def contended(self, protocol: Protocol) -> list[Run]:
        """The runs that other programs disturbed, see `session_statistics.contended`."""
        disturbed = []
        for name in dict.fromkeys(run.configuration for run in self.runs):
            runs = [run for run in self.of(name) if run.status == "ok"]
            each = session_statistics.contended([run.time(protocol) for run in runs])
            disturbed += [run for run, is_so in zip(runs, each, strict=True) if is_so]
        return disturbed

    def speedup(self, configuration: str, asked: Manifest, baseline: str = DEFAULT) -> Speedup | None:
        """The speedup over the baseline, as the server computes it. None without a pair of valid runs."""
        base, own = (
            {run.repeat: run.time(asked.protocol) for run in self.of(name) if run.valid(asked)}
            for name in (baseline, configuration)
        )
        return session_statistics.compare(base, own, self.on_processor)

    def slowed_down(self, protocol: Protocol) -> float | None:
        """How many times longer the later runs of all configurations took, see
        `session_statistics.slowed_down`."""
        good = sorted((run for run in self.runs if run.status == "ok"), key=lambda run: run.order)
        times: dict[str, list[float]] = {}
        for run in good:
            times.setdefault(run.configuration, []).append(run.mean_seconds(protocol))
        return session_statistics.slowed_down(times.values())


def begin(asked: Manifest, backend: str, threads: int | None, on_processor: bool = False) -> Session:
    """A session that begins now, without runs; `threads` execute its runs over WebAssembly."""
    return Session(
        id=uuid.uuid4(),
        started_at=datetime.now(UTC).replace(microsecond=0),
        application=asked.application,
        front_version=asked.front_version,
        protocol_version=asked.protocol.version,
        backend=cast(Backend, backend),
        runs=(),
        stage_clock=NO_STAGES,  # until a report names their clock
        threads=threads,
        blocks_repeated=0,
        samples=[],
        on_processor=on_processor,
    )


def payload(
    session: Session, asked: Manifest, device: Mapping[str, str | None], show_model: bool | None = None
) -> dict[str, Any]:
    """The body of POST /submissions for one session. A long session has more samples than a server accepts:
    every nth is sent."""
    step = max(1, math.ceil(len(session.samples) / MAX_SAMPLES))
    submission = Submission(
        schema_version=SCHEMA_VERSION,
        app_version=__version__,
        consent_version=asked.consent_version,
        device=dict(device),
        sessions=[msgspec.structs.replace(session, samples=session.samples[::step], on_processor=False)],
        show_model=show_model,
    )
    sent: dict[str, Any] = msgspec.to_builtins(submission)
    return sent
