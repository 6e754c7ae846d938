"""The record of a measuring session, its results, and its payload."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import fmean, median, stdev
from typing import Any

from client_kit.delivery.manifest import Manifest, Protocol
from client_kit.device.sensors import Sample
from frontrunner import __version__
from slam.protocol import LEAST_PAIRS, NO_STAGES

SCHEMA_VERSION = 1
MOST_SAMPLES = 5_000
MICROSECONDS = 1e6
# Student's t, two-sided 95 %, for 1 to 24 degrees of freedom: a session has at most 25 pairs of runs.
T_QUANTILES = (
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179,
    2.160, 2.145, 2.131, 2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064,
)  # fmt: skip


@dataclass(frozen=True)
class Run:
    """One configuration over the sequence. Times in microseconds, a value a frame; errors in metres.

    `repeat` counts the runs of this configuration in the session, `order` all runs, both from 0. A failed run
    has its reason in `failure`, and times and errors only if it reached the end of the sequence.
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

    def stage_seconds(self, protocol: Protocol) -> dict[str, float]:
        """Mean seconds a frame of each stage, over the frames that count."""
        first = protocol.first_counted_frame
        return {stage: fmean(series[first:]) / MICROSECONDS for stage, series in self.stages_us.items()}

    def valid(self, protocol: Protocol) -> bool:
        """Whether its speed counts: it ran, and its trajectory stayed within the limits."""
        accurate = self.ate_max is not None and self.ate_max < protocol.max_ate
        return self.status == "ok" and accurate and not self.deviates


@dataclass(frozen=True)
class Speedup:
    """The speedup over the baseline; `low` and `high` bound it with 95 % confidence.

    The interval is over the session's `pairs` of runs: the repeatability within this session. None for too
    few pairs.
    """

    value: float
    low: float | None
    high: float | None
    pairs: int


@dataclass(frozen=True)
class Session:
    """The runs of one session on one device, with samples of its state.

    `interrupted`: it was ended early; its finished runs are complete.
    `stage_clock` measured the stages: "device", "wall" or NO_STAGES. `empty_frame_us` is the cost of an empty
    frame.
    """

    id: str
    started_at: str
    backend: str
    runs: tuple[Run, ...]
    samples: tuple[Sample, ...]
    empty_frame_us: float
    stage_clock: str
    interrupted: bool = False

    def of(self, configuration: str) -> list[Run]:
        """The runs of one configuration, in order."""
        return [run for run in self.runs if run.configuration == configuration]

    def speedup(self, configuration: str, protocol: Protocol, baseline: str = "default") -> Speedup | None:
        """exp of the mean of the paired log ratios, with their t interval. None without a valid pair."""
        return speedup_of(self.runs, configuration, protocol, baseline)

    def drift(self, configuration: str, protocol: Protocol) -> float | None:
        """The slowdown of the second half of its good runs over the first: median over the counted frames of
        the ratio of their means. None with fewer than two such runs."""
        good = [
            run.frame_us[protocol.first_counted_frame :]
            for run in self.of(configuration)
            if run.status == "ok"
        ]
        half = len(good) // 2
        earlier, later = good[:half], good[len(good) - half :]
        ratios = [
            fmean(after) / fmean(before)
            for before, after in zip(zip(*earlier, strict=True), zip(*later, strict=True), strict=True)
            if all(before) and all(after)
        ]
        return median(ratios) if ratios else None


def speedup_of(
    runs: Sequence[Run], configuration: str, protocol: Protocol, baseline: str = "default"
) -> Speedup | None:
    """The speedup over the baseline, as the server computes it.

    The first run of one is paired with the first of the other, the second with the second; with the order
    default, best, best, default a steady drift cancels. None without a pair of valid runs.
    """
    by_repeat = {run.repeat: run for run in runs if run.configuration == baseline and run.valid(protocol)}
    logs = [
        math.log(by_repeat[run.repeat].mean_seconds(protocol) / run.mean_seconds(protocol))
        for run in runs
        if run.configuration == configuration and run.valid(protocol) and run.repeat in by_repeat
    ]
    if not logs:
        return None
    centre = fmean(logs)
    if len(logs) < LEAST_PAIRS:
        return Speedup(math.exp(centre), None, None, len(logs))
    quantile = T_QUANTILES[min(len(logs) - 1, len(T_QUANTILES)) - 1]
    half = quantile * stdev(logs) / math.sqrt(len(logs))
    return Speedup(math.exp(centre), math.exp(centre - half), math.exp(centre + half), len(logs))


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
                "empty_frame_us": session.empty_frame_us,
                "stage_clock": session.stage_clock,
                "samples": [dict(sample) for sample in _thinned(session.samples)],
                "runs": [_document(run, session.stage_clock) for run in session.runs],
            }
        ],
    }


def _thinned(samples: Sequence[Sample]) -> Sequence[Sample]:
    """Every nth of SAMPLES: a long session has more than the server accepts."""
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
    }
