"""`run --front`: picks a point of a front's file before the run, by the time and error that it predicts."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from groundwork import terminal
from slam.cli.arguments import UsageError, number

BEST = "best"


@dataclass(frozen=True)
class Point:
    """A configuration of a front. `runtime`: seconds a frame on the reference device. `ate_max`: its largest
    error (m) there, over all sequences. `on`: where it was that large, "" if that is unknown."""

    name: str
    parameters: Mapping[str, Any]
    runtime: float
    ate_max: float
    on: str = ""

    def __str__(self) -> str:
        where = f" on {self.on}" if self.on else ""
        return f"{self.name} ({1e3 * self.runtime:.3g} ms a frame, {100 * self.ate_max:.3g} cm{where})"


@dataclass(frozen=True)
class Front:
    """A front's file: its system, its reference device and the points that keep the camera there."""

    system: str
    device: str
    points: tuple[Point, ...]


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that pick a point of a front."""
    parser.add_argument(
        "--front",
        type=Path,
        metavar="FILE",
        help="run a point of this front: the most accurate within --max-ms, else the fastest within "
        f"--max-ate, else the one called {BEST}",
    )
    parser.add_argument(
        "--max-ms", type=number, metavar="T", help="milliseconds a frame, on the front's reference device"
    )
    parser.add_argument(
        "--max-ate", type=number, metavar="M", help="largest error there, over all sequences, metres"
    )


def parameters(options: argparse.Namespace) -> Mapping[str, Any] | None:
    """The parameters of the point that `options` pick, and a note why; None without --front.

    Raises UsageError where no point fits, options contradict, or the file is not a front of the system.
    """
    if options.front is None:
        if options.max_ms is not None or options.max_ate is not None:
            raise UsageError("--max-ms and --max-ate pick a point of a front: give --front FILE")
        return None
    if options.set:
        raise UsageError("--front and --set: give one of them, a point of a front has all parameters")
    front = read(options.front)
    if front.system != options.system:
        raise UsageError(f"{options.front} is a front of {front.system}: add --system {front.system}")
    point, reason = pick(front.points, options.max_ms, options.max_ate)
    terminal.note(f"running {point}: {reason}; predicted for {front.device}")
    return point.parameters


def read(path: Path) -> Front:
    """The front in the file `path`. Raises UsageError where it is not one, OSError if it cannot be read."""
    text = path.read_text(encoding="utf-8")
    try:
        document = json.loads(text)
        points = tuple(
            Point(
                str(point["name"]),
                dict(point["parameters"]),
                float(point["predicted"]["runtime"]),
                *_largest_error(point),
            )
            for point in document["configurations"]
            if point["predicted"]["ate_max"] is not None  # null: the camera was lost
        )
        device = str(document.get("provenance", {}).get("device", "the front's reference device"))
        system = str(document["application"])
    except KeyError as error:
        raise UsageError(f"{path} is not the file of a front: it lacks {error}") from None
    except (ValueError, TypeError, AttributeError) as error:
        raise UsageError(f"{path} is not the file of a front: {error}") from None
    if not points:
        raise UsageError(f"{path} has no point with a predicted error: give another front")
    return Front(system, device, points)


def _largest_error(point: Mapping[str, Any]) -> tuple[float, str]:
    """The largest error (m) of a `point` of a file, predicted or measured on any sequence, and on which."""
    results = [*point.get("learned_on", ()), *point.get("held_out", ())]
    errors = [(float(result["ate_max"]), str(result["sequence"])) for result in results]
    return max([*errors, (float(point["predicted"]["ate_max"]), "")])


def pick(points: Sequence[Point], max_ms: float | None, max_ate: float | None) -> tuple[Point, str]:
    """The point to run, and the reason in words.

    With `max_ms` it is the most accurate point that keeps both limits, with `max_ate` (m) alone the fastest.
    Ties go to the faster and to the more accurate one. Without limits it is the point called BEST.
    Raises UsageError, which names the nearest point, where none fits.
    """
    if max_ms is None and max_ate is None:
        for point in points:
            if point.name == BEST:
                return point, "no limit is given, so the front's best point"
        raise UsageError(f"the front has no point called {BEST}: give --max-ms or --max-ate")
    seconds, error = math.inf if max_ms is None else max_ms / 1e3, math.inf if max_ate is None else max_ate
    fast = [point for point in points if point.runtime <= seconds]
    if not fast:
        nearest = min(points, key=_speed)
        raise UsageError(f"no point takes at most {max_ms:g} ms a frame: the nearest is {nearest}")
    fitting = [point for point in fast if point.ate_max <= error]
    if not fitting:
        within = "" if max_ms is None else f" within {max_ms:g} ms a frame"
        nearest = min(fast, key=_accuracy)
        raise UsageError(
            f"no point{within} has an error of at most {100 * error:g} cm: the nearest is {nearest}"
        )
    limits = [f"{max_ms:g} ms a frame"] if max_ms is not None else []
    limits += [f"{100 * error:g} cm"] if max_ate is not None else []
    word, order = ("most accurate", _accuracy) if max_ms is not None else ("fastest", _speed)
    chosen = min(fitting, key=order)
    return chosen, f"the {word} of {len(fitting)} points within {' and '.join(limits)}"


def _speed(point: Point) -> tuple[float, float]:
    return point.runtime, point.ate_max


def _accuracy(point: Point) -> tuple[float, float]:
    return point.ate_max, point.runtime
