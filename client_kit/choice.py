"""Which configuration of the published front to run on this device: the paper's run-time adaptation."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from statistics import fmean
from typing import Any

from client_kit.errors import CannotMeasureError
from client_kit.manifest import Manifest
from pareto.fronts import front

MEASURED, SCALED = "measured here", "scaled from the reference device"


@dataclass(frozen=True)
class Point:
    """A configuration with its time (s a frame) and largest trajectory error (m) on this device.

    `source` tells whether it was measured here, or is the reference device's time multiplied by the ratio
    of this device's default to the reference's.
    """

    name: str
    parameters: Mapping[str, Any]
    runtime: float
    ate_max: float
    source: str


def points(manifest: Manifest, payloads: Iterable[Mapping[str, Any]]) -> list[Point]:
    """Every configuration of the front with what is known of it here.

    `payloads` are the sessions that this device has measured; those of other fronts are disregarded. A
    configuration that was measured here has the mean of its runs and its worst error; the others have the
    reference's error and scaled time, and are left out while nothing was measured here to scale by. One of
    which half of the runs failed here, or more, is left out too. A run outside its configuration's band has
    failed: this device computes something else.
    """
    times: dict[str, list[float]] = {}
    errors: dict[str, list[float]] = {}
    failures: Counter[str] = Counter()
    for run in _runs(manifest, payloads):
        name = run["configuration"]
        if run["status"] != "ok" or run["ate_max"] is None or _deviates(manifest, run):
            failures[name] += 1
            continue
        counted = run["frame_us"][manifest.protocol.first_counted_frame :]
        times.setdefault(name, []).append(fmean(counted) / 1e6)
        errors.setdefault(name, []).append(run["ate_max"])
    reference = manifest.configurations["default"].predicted.get("runtime")
    scale = fmean(times["default"]) / reference if "default" in times and reference else None
    found = []
    for name, configuration in manifest.configurations.items():
        predicted = configuration.predicted
        if failures[name] and failures[name] >= len(times.get(name, ())):
            continue
        if name in times:
            here = Point(name, configuration.parameters, fmean(times[name]), max(errors[name]), MEASURED)
            found.append(here)
            continue
        runtime, ate_max = predicted.get("runtime"), predicted.get("ate_max")
        if scale and runtime is not None and ate_max is not None:
            found.append(Point(name, configuration.parameters, runtime * scale, ate_max, SCALED))
    return found


def of_one_device(payloads: Iterable[Mapping[str, Any]], text: str | None = None) -> list[Mapping[str, Any]]:
    """Those `payloads`, oldest first, that come from the device that was measured last, or from the
    last one whose name or platform contains `text`: times of two devices say nothing of each other."""
    matching = [one for one in payloads if not text or text.lower() in " ".join(device_of(one)).lower()]
    return [payload for payload in matching if device_of(payload) == device_of(matching[-1])]


def choose(candidates: list[Point], max_ate: float, max_seconds: float | None = None) -> Point:
    """The point to run: the fastest with an error of at most `max_ate` metres; where a time of
    `max_seconds` a frame is enough, the most accurate that keeps both limits.

    Raises CannotMeasureError, naming the nearest value, when no point keeps the limits.
    """
    if not candidates:
        raise CannotMeasureError("nothing was measured here yet: run the client once, then choose")
    entries = [(point, {"ate_max": point.ate_max, "runtime": point.runtime}) for point in candidates]
    limits = {"ate_max": max_ate}
    if max_seconds is not None:
        limits["runtime"] = max_seconds
    try:
        point, _ = front.choose(entries, limits, prefer="runtime" if max_seconds is None else "ate_max")
    except front.NothingWithinLimitsError as error:
        raise CannotMeasureError(str(error)) from error
    return point


def device_of(payload: Mapping[str, Any]) -> tuple[str, str]:
    """Name and platform of the device that PAYLOAD was measured on."""
    device = payload["device"]
    return str(device.get("opencl_device")), str(device.get("opencl_platform"))


def _deviates(manifest: Manifest, run: Mapping[str, Any]) -> bool:
    configuration, deviation = manifest.configurations.get(run["configuration"]), run.get("deviation")
    if configuration is None or configuration.band is None or deviation is None:
        return False
    return bool(deviation > configuration.band)


def _runs(manifest: Manifest, payloads: Iterable[Mapping[str, Any]]) -> Iterable[Mapping[str, Any]]:
    for payload in payloads:
        for session in payload["sessions"]:
            if (session["application"], session["front_version"]) == (
                manifest.application,
                manifest.front_version,
            ):
                yield from session["runs"]
