"""From an exploration to a front that clients measure."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from django.utils import timezone

from crowd.explorations import points
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.points import Point
from crowd.fronts import services as fronts
from crowd.fronts.models import FrontVersion
from pareto.front import nondominated

MAX_ATE = 0.05  # metres: a configuration is valid below it
PREDICTED = ("runtime", "ate_max", "ate_mean")
PROTOCOL = {
    "version": 1,
    "warmup_frames": 10,
    "frames": 100,
    "first_counted_frame": 10,
    "order": ["default", "best", "best", "default"],
    "repeats": 2,
    "rest_seconds": 0,
    "max_ate": MAX_ATE,
}


class NothingToPublishError(ValueError):
    """An exploration that has no default, or nothing valid that is faster; the message says which."""


def publish(exploration: Exploration) -> FrontVersion:
    """Publish the exploration's front as its application's next version.

    Raises NothingToPublishError, and what crowd.fronts.services.publish_content raises.
    """
    versions = FrontVersion.objects.filter(application=exploration.application).values_list(
        "version", flat=True
    )
    newest = max((int(version) for version in versions if version.isdecimal()), default=0)
    return fronts.publish_content(document(exploration, str(newest + 1)))[0]


def document(exploration: Exploration, version: str) -> dict[str, Any]:
    """The exploration's front in the shape of a front file; no figure in it is anybody's opinion.

    Raises NothingToPublishError where there is no default, or nothing valid is faster than it.
    """
    evaluations = list(exploration.evaluations.all())
    chosen = name_points(points.measured(evaluations))
    return {
        "application": exploration.application,
        "version": version,
        "protocol": PROTOCOL,
        "sequence": {"name": exploration.sequence, "sha256": exploration.sequence_sha256},
        "configurations": [
            {
                "name": name,
                "parameters": point.configuration,
                "predicted": {value: point.values[value] for value in PREDICTED},
            }
            for name, point in chosen.items()
        ],
        "provenance": _provenance(exploration, evaluations, list(chosen.values())),
    }


def name_points(measured: Sequence[Point]) -> dict[str, Point]:
    """What is published, by name: default, best, accurate, the other known ones, the rest of the front.

    `best` is the fastest valid point, `accurate` the valid one with the least maximal error. Where any point
    was measured again, only those that were take part: a single lucky measurement makes no front.
    """
    again = [point for point in measured if point.repeats] or list(measured)
    default = points.default(again)
    if default is None:
        raise NothingToPublishError(
            "the default configuration was not measured: there is nothing to compare with"
        )
    valid = sorted(
        (point for point in again if point.values["ate_max"] < MAX_ATE),
        key=lambda point: point.values["runtime"],
    )
    if not valid or valid[0].values["runtime"] >= default.values["runtime"]:
        raise NothingToPublishError(
            "no configuration that keeps its error below 5 cm is faster than the default"
        )
    table = np.array([[point.values["ate_max"], point.values["runtime"]] for point in valid])
    on_front = [point for point, keep in zip(valid, nondominated(table), strict=True) if keep]
    named = {"default": default, "best": valid[0]}
    accurate = min(valid, key=lambda point: point.values["ate_max"])
    if accurate not in named.values():
        named["accurate"] = accurate
    named |= {point.label: point for point in again if point.label and point not in named.values()}
    others = [point for point in on_front if point not in named.values()]
    return named | {f"front-{number:02}": point for number, point in enumerate(others, start=1)}


def _provenance(
    exploration: Exploration, evaluations: Sequence[Evaluation], published: Sequence[Point]
) -> dict[str, Any]:
    done = [evaluation for evaluation in evaluations if evaluation.state == Evaluation.State.DONE]
    failed = [evaluation for evaluation in evaluations if evaluation.state == Evaluation.State.FAILED]
    device = done[-1].device or {}
    repeats = [point.measurements for point in published]
    return {
        "device": device.get("name"),
        "driver": device.get("driver"),
        "platform": device.get("platform"),
        "reference_device": exploration.reference_device.name,
        "date": (exploration.finished_at or timezone.now()).date().isoformat(),
        "software": ", ".join(sorted({evaluation.software for evaluation in done})),
        "sequence_sha256": exploration.sequence_sha256,
        "protocol": (
            "each measurement is a fresh process over the whole sequence; runtime is the mean computation "
            "time of frames 10 and later; published values are medians over measurements made in turn, "
            f"{_range(repeats)} of each point"
        ),
        "evaluations": len(done) + len(failed),
        "failed": len(failed),
        "invalid": sum(
            evaluation.objectives["ate_max"] >= MAX_ATE for evaluation in done if evaluation.objectives
        ),
        "search": {
            "method": exploration.method,
            "seed": exploration.seed,
            "budget": exploration.budget,
            "batch": exploration.batch,
            "objectives": exploration.objectives,
            "limits": exploration.limits,
            "space": exploration.space.get("name"),
        },
        "command": exploration.command,
    }


def _range(numbers: Sequence[int]) -> str:
    return str(min(numbers)) if min(numbers) == max(numbers) else f"{min(numbers)} to {max(numbers)}"
