"""The record of a measuring session, its results, and its payload."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import fmean
from typing import Any

import numpy as np

from client_kit.delivery.manifest import Manifest, Protocol
from client_kit.device.sensors import Sample
from groundwork import __version__
from wire import session_statistics
from wire.protocol import NO_STAGES
from wire.session_statistics import ProcessorTime, Speedup, contended

SCHEMA_VERSION = 1
MOST_SAMPLES = 5_000
MICROSECONDS = 1e6


@dataclass(frozen=True)
class Run:
    """One configuration over the sequence. Times in microseconds, a value a frame; errors in metres.

    `repeat` counts the runs of this configuration in the session, `order` all runs, both from 0. A failed run
    has its reason in `failure`, and times and errors only if it reached the end of the sequence.
    `cpu_us` and `waited_us` are of the counted frames, see `processor_time`.
    `deviation` is the largest distance (m) from the reference trajectory, `band` the largest that counts.
    Both are None for a failed run.
    """

    id: str
    configuration: str
    repeat: int
    order: int
    status: str
    failure: str | None = None
    frame_us: tuple[int, ...] = ()
    stages_us: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    tracked: tuple[bool | None, ...] = ()
    ate_max: float | None = None
    ate_mean: float | None = None
    ate_rmse: float | None = None
    cpu_us: int | None = None
    waited_us: int | None = None
    deviation: float | None = None
    band: float | None = None

    @property
    def deviates(self) -> bool:
        """Whether it left the band around its reference trajectory."""
        return self.deviation is not None and self.band is not None and self.deviation > self.band

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

    def stage_seconds(self, protocol: Protocol) -> dict[str, float]:
        """Mean seconds a frame of each stage, over the frames that count."""
        first = protocol.first_counted_frame
        return {stage: fmean(series[first:]) / MICROSECONDS for stage, series in self.stages_us.items()}

    def valid(self, protocol: Protocol) -> bool:
        """Whether its speed counts: it ran, and its trajectory stayed within the limits."""
        accurate = self.ate_max is not None and self.ate_max < protocol.max_ate
        return self.status == "ok" and accurate and not self.deviates


@dataclass(frozen=True)
class Session:
    """The runs of one session on one device, with samples of its state.

    `interrupted`: it was ended early; its finished runs are complete.
    `stage_clock` measured the stages: "device", "wall" or NO_STAGES. `empty_frame_us` is the cost of an empty
    frame. `blocks_repeated`: how often runs were measured again because other programs disturbed them.
    `threads` executed all runs over WebAssembly; None over other backends.
    """

    id: str
    started_at: str
    backend: str
    runs: tuple[Run, ...]
    samples: tuple[Sample, ...]
    empty_frame_us: float
    stage_clock: str
    interrupted: bool = False
    blocks_repeated: int = 0
    threads: int | None = None

    def of(self, configuration: str) -> list[Run]:
        """The runs of one configuration, in order."""
        return [run for run in self.runs if run.configuration == configuration]

    def contended(self, protocol: Protocol) -> list[Run]:
        """The runs that other programs disturbed, see `session_statistics.contended`."""
        first = protocol.first_counted_frame
        disturbed = []
        for name in dict.fromkeys(run.configuration for run in self.runs):
            runs = [run for run in self.of(name) if run.status == "ok"]
            times = [ProcessorTime(sum(run.frame_us[first:]), run.cpu_us, run.waited_us) for run in runs]
            disturbed += [run for run, is_so in zip(runs, contended(times), strict=True) if is_so]
        return disturbed

    def speedup(self, configuration: str, protocol: Protocol, baseline: str = "default") -> Speedup | None:
        """The speedup over the baseline, as the server computes it. None without a pair of valid runs."""
        times, base = (
            {run.repeat: run.mean_seconds(protocol) for run in self.of(name) if run.valid(protocol)}
            for name in (configuration, baseline)
        )
        ratios = session_statistics.paired_log_ratios(base, times)
        disturbed = {run.configuration for run in self.contended(protocol)}
        return session_statistics.speedup(ratios, not disturbed.isdisjoint({configuration, baseline}))

    def slowed_down(self, protocol: Protocol) -> float | None:
        """How many times longer the later runs of all configurations took, see
        `session_statistics.slowed_down`."""
        good = sorted((run for run in self.runs if run.status == "ok"), key=lambda run: run.order)
        times: dict[str, list[float]] = {}
        for run in good:
            times.setdefault(run.configuration, []).append(run.mean_seconds(protocol))
        return session_statistics.slowed_down(times.values())


def payload(
    session: Session, manifest: Manifest, device: Mapping[str, str | None], show_model: bool | None = None
) -> dict[str, Any]:
    """The body of POST /submissions for one session; `show_model` is sent where it is not None."""
    return {
        "schema_version": SCHEMA_VERSION,
        "app_version": __version__,
        "consent_version": manifest.consent_version,
        **({} if show_model is None else {"show_model": show_model}),
        "device": dict(device),
        "sessions": [
            {
                "id": session.id,
                "started_at": session.started_at,
                "application": manifest.application,
                "front_version": manifest.front_version,
                "protocol_version": manifest.protocol.version,
                "backend": session.backend,
                **({} if session.threads is None else {"threads": session.threads}),
                "empty_frame_us": session.empty_frame_us,
                "stage_clock": session.stage_clock,
                "blocks_repeated": session.blocks_repeated,
                "samples": [dict(sample) for sample in _thinned(session.samples)],
                "runs": [_document(run, session.stage_clock) for run in session.runs],
            }
        ],
    }


def _thinned(samples: Sequence[Sample]) -> Sequence[Sample]:
    """Every nth of `samples`: a long session has more than the server accepts."""
    return samples[:: max(1, math.ceil(len(samples) / MOST_SAMPLES))]


def _document(run: Run, stage_clock: str) -> dict[str, Any]:
    stages = {"stages_us": {stage: list(series) for stage, series in run.stages_us.items()}}
    return {
        "id": run.id,
        "configuration": run.configuration,
        "repeat": run.repeat,
        "order": run.order,
        "status": run.status,
        "failure": run.failure,
        "frame_us": list(run.frame_us),
        **({} if stage_clock == NO_STAGES else stages),
        "tracked": list(run.tracked),
        "ate_max": run.ate_max,
        "ate_mean": run.ate_mean,
        "ate_rmse": run.ate_rmse,
        **({} if run.deviation is None else {"deviation": run.deviation}),
        **({} if run.cpu_us is None else {"cpu_us": run.cpu_us}),
        **({} if run.waited_us is None else {"waited_us": run.waited_us}),
    }
