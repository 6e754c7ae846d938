"""Rows as selectors answer them, made up for testing figures."""

import uuid
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

import msgspec
import numpy as np

from crowd.devices.naming.chips import vendor
from crowd.fronts import selectors
from crowd.records.device import Device
from crowd.records.run import RunRow
from crowd.records.speedup import Speedup
from crowd.results.reading.queries.filters import SpeedupFilters
from crowd.results.reading.rows import RunSeries
from crowd.results.reading.selectors import Speedups
from crowd.results.validity.version import ALGORITHM
from wire.front import Content, Front

RUN = uuid.UUID("00000000-0000-4000-8000-000000000001")


def device(slug: str = "phone", **changes: Any) -> Device:
    """A phone of which only its name is known."""
    known: dict[str, Any] = {
        "manufacturer": "",
        "name": slug.title(),
        "cpu": "",
        "soc": "",
        "gpu": "",
        "os": "Android",
        "kind": "device",
    }
    shown = {"slug": slug} | known | changes
    return Device(vendor=vendor("", shown["gpu"]), **shown)


def speedup(value: float = 6.0, slug: str = "phone", **changes: Any) -> Speedup:
    """One confirmed figure of `best`, without an interval."""
    fields: dict[str, Any] = {
        "device": device(slug),
        "front": "kfusion-test",
        "configuration": "best",
        "baseline": "default",
        "backend": "opencl",
        "processor": "Mali-G78",
        "processor_class": "gpu",
        "speedup": value,
        "low": None,
        "high": None,
        "session_low": None,
        "session_high": None,
        "repeat_low": None,
        "repeat_high": None,
        "deviation": None,
        "units": 1,
        "sessions": 2,
        "installations": 1,
        "ate_max": 0.02,
        "last_session_at": datetime(2026, 11, 20, 10, tzinfo=UTC),
        "validity": "suspect" if changes.pop("suspect", False) else "valid",
        "confirmed": True,
        "witnesses": 2,
        "algorithm": ALGORITHM,
    }
    shown = fields | changes
    chip = (shown["processor"], shown["device"].gpu, shown["processor_class"])
    return Speedup(vendor=vendor(*chip), **shown)


def crowd(*rows: Speedup) -> Speedups:
    """The crowd of these figures, without filters."""
    return Speedups(SpeedupFilters(), "kfusion-test", rows, ())


def run(
    configuration: str = "default",
    seconds: float = 0.1,
    stages: dict[str, float] | None = None,
    frames: int = 20,
    **changes: Any,
) -> RunSeries:
    """A run whose frames all take `seconds`, of which each stage takes its share."""
    fields: dict[str, Any] = {
        "uuid": RUN,
        "session": RUN,
        "device": device(),
        "application": "kfusion",
        "front": "kfusion-test",
        "backend": "opencl",
        "processor": "Mali-G78",
        "processor_class": "gpu",
        "started_at": datetime(2026, 11, 20, 10, tzinfo=UTC),
        "configuration": configuration,
        "repeat": 0,
        "order": 0,
        "status": "ok",
        "failure": "",
        "mean_us": seconds * 1e6,
        "tracked_frames": frames,
        "ate_max": 0.02,
        "ate_mean": 0.01,
        "ate_rmse": 0.012,
        "deviation": None,
        "cpu_us": None,
        "waited_us": None,
        "state": "valid",
        "reason": "",
    }
    shares = {"raycasting": 0.5, "tracking": 0.3, "preprocessing": 0.2} if stages is None else stages
    return RunSeries(
        run=RunRow(**(fields | changes)),
        frame_seconds=np.full(frames, seconds),
        stage_seconds={name: np.full(frames, seconds * share) for name, share in shares.items()},
        tracked=(),
    )


def front_of(document: Mapping[str, Any]) -> Front:
    """The front of `document`, whatever its checks say; it is not stored."""
    return selectors.of_content(msgspec.convert({**document, "version": str(document["version"])}, Content))
