"""Which configuration of the published front to run on this device: the paper's run-time adaptation."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any

import msgspec

from client_kit.delivery.manifest import Manifest
from client_kit.delivery.server import NotFrontrunnerError
from client_kit.errors import CannotMeasureError
from pareto.fronts import front
from wire.front import DEFAULT
from wire.recommendation import Point as Prediction
from wire.recommendation import Recommendation

MEASURED, PREDICTED = "measured here", "predicted by the crowd"
SCALED = "scaled from the reference device"


@dataclass(frozen=True)
class Point:
    """A configuration with its time (s a frame) and largest trajectory error (m) on this device.

    `source` tells whether it was measured here, was predicted from the measurements of other devices, or is
    the reference device's time multiplied by the ratio of this device's default to the reference's. A
    prediction has its 95 % interval, from `low` to `high`.
    """

    name: str
    parameters: Mapping[str, Any]
    runtime: float
    ate_max: float
    source: str
    low: float | None = None
    high: float | None = None


def points(
    manifest: Manifest,
    payloads: Iterable[Mapping[str, Any]],
    predictions: Sequence[Prediction] = (),
) -> list[Point]:
    """Every configuration of the front, and of `predictions`, with its known figures on this device.

    `payloads` are this device's sessions; those of other fronts are ignored. A
    configuration that was measured here has the mean of its runs and its worst error. The others have the
    default's time here divided by the predicted speedup, or the reference's error and scaled time where
    nothing is predicted. They are left out while no default was measured here. A configuration is left out,
    too, if at least half of its runs failed here. A run outside its configuration's band counts as failed:
    this device computes something else.
    """
    times: dict[str, list[float]] = {}
    errors: dict[str, list[float]] = {}
    failures: Counter[str] = Counter()
    for run in _runs(manifest, payloads):
        name = run["configuration"]
        if run["status"] != "ok" or run.get("ate_max") is None or _deviates(manifest, run):
            failures[name] += 1
            continue
        counted = run["frame_us"][manifest.protocol.first_counted_frame :]
        times.setdefault(name, []).append(fmean(counted) / 1e6)
        errors.setdefault(name, []).append(run["ate_max"])
    reference = manifest.by_name[DEFAULT].predicted.runtime
    default = fmean(times[DEFAULT]) if DEFAULT in times else None
    crowd = {one.configuration: one for one in predictions}
    parameters = {one.configuration: one.parameters for one in predictions}
    parameters |= {name: configuration.parameters for name, configuration in manifest.by_name.items()}
    choices = []
    for name, values in parameters.items():
        configuration, prediction = manifest.by_name.get(name), crowd.get(name)
        predicted = configuration.predicted if configuration else None
        if failures[name] and failures[name] >= len(times.get(name, ())):
            continue
        if name in times:
            choices.append(Point(name, values, fmean(times[name]), max(errors[name]), MEASURED))
        elif default is None:
            continue
        # In a newer front a name may have other parameters than in the stored one.
        elif prediction and prediction.parameters == values:
            ate_max = prediction.ate_max
            if ate_max is None and predicted:
                ate_max = predicted.ate_max
            if ate_max is not None:
                choices.append(_predicted_point(prediction, default, ate_max))
        elif reference and predicted and predicted.ate_max is not None:
            runtime = predicted.runtime * default / reference
            choices.append(Point(name, values, runtime, predicted.ate_max, SCALED))
    return choices


def predictions(answer: Mapping[str, Any]) -> tuple[Prediction, ...]:
    """The predictions in a server's answer of GET /recommendation. Raises NotFrontrunnerError where it is
    malformed."""
    try:
        return msgspec.convert(answer, Recommendation).front
    except msgspec.ValidationError as error:
        raise NotFrontrunnerError(f"the server's recommendation is malformed: {error}") from error


def of_one_device(payloads: Iterable[Mapping[str, Any]], text: str | None = None) -> list[Mapping[str, Any]]:
    """Those `payloads`, oldest first, that come from the device that was measured last, or from the last one
    whose name or platform contains `text`: times of different devices cannot be compared."""
    matching = [one for one in payloads if not text or text.lower() in " ".join(device_of(one)).lower()]
    return [payload for payload in matching if device_of(payload) == device_of(matching[-1])]


def choose(candidates: list[Point], max_ate: float, max_seconds: float | None = None) -> Point:
    """The point to run: the fastest with an error of at most `max_ate` metres; with a limit of `max_seconds`
    a frame, the most accurate that keeps both limits.

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
    """Name and platform of the device that `payload` was measured on.

    Over WebAssembly, where no driver is named: the processor and the backend.
    """
    device = payload["device"]
    if device.get("opencl_device") is None:
        return str(device.get("cpu")), "WebAssembly"
    return str(device.get("opencl_device")), str(device.get("opencl_platform"))


def _predicted_point(prediction: Prediction, default: float, ate_max: float) -> Point:
    """`prediction` on a device whose default takes `default` seconds a frame."""
    return Point(
        prediction.configuration,
        prediction.parameters,
        default / prediction.ratio,
        ate_max,
        PREDICTED,
        low=default / prediction.high,
        high=default / prediction.low,
    )


def _deviates(manifest: Manifest, run: Mapping[str, Any]) -> bool:
    configuration, deviation = manifest.by_name.get(run["configuration"]), run.get("deviation")
    if configuration is None or deviation is None:
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
