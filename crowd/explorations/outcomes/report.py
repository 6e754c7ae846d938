"""The report of an exploration in Markdown: the yield of each phase, and the points of the front."""

from collections.abc import Iterable, Sequence
from typing import Any

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.searching import points
from crowd.explorations.searching.points import Point

PHASES = {Evaluation.Phase.RANDOM: "random samples", Evaluation.Phase.ACTIVE: "active learning"}


def markdown(exploration: Exploration) -> str:
    """Two tables: the yield of each phase of the search, and default, front and known configurations.

    With several sequences, the second has the largest error on each, held-out ones included. Valid means
    within all limits. Fronts in the first table are of single measurements; the second has medians over
    repeats. If the search runs fewer frames, a line says over how many each was measured.
    """
    rows = list(exploration.evaluations.exclude(phase=Evaluation.Phase.PRIOR).order_by("number"))
    every = points.comparable(points.measured_points(rows))
    parts = [
        *_sequences(exploration),
        *_frames(exploration, whole=exploration.frames is None),
        _yields(exploration, rows),
        *_frames(exploration, whole=all(point.whole for point in every)),
        _points(exploration, every, rows),
    ]
    return "\n\n".join(parts) + "\n"


def _sequences(exploration: Exploration) -> list[str]:
    """Which sequences errors are taken from, if there are several."""
    lines = []
    if exploration.further_sequences:
        allowed = exploration.failures_allowed
        larger = f", on {allowed} of them it may be larger" if allowed else ""
        names = ", ".join(pack["name"] for pack in exploration.learned_on)
        lines.append(f"Learned on {names}: an error is the worst of these{larger}, a runtime is the mean.")
    if exploration.held_out_sequences:
        names = ", ".join(pack["name"] for pack in exploration.held_out_sequences)
        lines.append(f"Held out, not used by the search: {names}.")
    return lines


def _frames(exploration: Exploration, whole: bool) -> list[str]:
    """How many frames were measured, if the search does not run the whole sequence."""
    if exploration.frames is None:
        return []
    return [f"Measured over the {'whole sequence' if whole else f'first {exploration.frames} frames'}:"]


def _yields(exploration: Exploration, rows: Sequence[Evaluation]) -> str:
    searched = [row for row in rows if row.phase in PHASES]
    whole = {_identity(point) for point in _front(exploration, searched)}
    lines: list[list[Any]] = []
    for phase, name in PHASES.items():
        of_phase = [row for row in searched if row.phase == phase]
        identities = {_identity(point) for point in points.measured_points(of_phase)}
        lines.append(
            [
                name,
                len(of_phase),
                sum(row.state == Evaluation.State.FAILED for row in of_phase),
                sum(_valid(exploration, row.objectives) for row in of_phase),
                len(_front(exploration, of_phase)),
                len(whole & identities),
            ]
        )
    lines.append(
        ["both", *(sum(line[column] for line in lines) for column in (1, 2, 3)), len(whole), len(whole)]
    )
    head = ["phase", "measured", "failed", "valid", "points on its own front", "points on the front of both"]
    return _table(head, lines)


def _points(exploration: Exploration, every: Sequence[Point], rows: Sequence[Evaluation]) -> str:
    again = [point for point in every if point.repeats or point.label]
    # Only among repeated points: a single lucky measurement must not beat their medians.
    front = {_identity(point) for point in points.best_points(exploration, again)}
    default = points.default_point(every)
    parameters = [parameter["name"] for parameter in exploration.space["parameters"]]
    sequences = _columns(exploration)
    largest = _largest(rows)
    lines: list[list[Any]] = []
    for point in sorted(again, key=lambda point: point.values.get("runtime", 0.0)):
        runtime, error = point.values.get("runtime"), point.values.get("ate_max")
        speedup = points.speedup(default, point)
        lines.append(
            [
                point.label or ("front" if _identity(point) in front else "near the front"),
                "" if runtime is None else f"{runtime * 1e3:.2f}",
                "" if speedup is None else f"{speedup:.1f}x",
                "" if error is None else f"{point.least}{error * 100:.2f}",
                *(_centimetres(largest.get((_identity(point), name))) for name in sequences),
                point.measurements,
                *(_written(point.configuration.get(name)) for name in parameters),
            ]
        )
    head = [
        *("configuration", "ms a frame", "speedup", "max ATE, cm", *sequences.values(), "measured"),
        *parameters,
    ]
    return _table(head, lines)


def _columns(exploration: Exploration) -> dict[str, str]:
    """The column title of each sequence by name; empty for a single sequence."""
    if len(exploration.learned_on) + len(exploration.held_out_sequences) == 1:
        return {}
    learned = {pack["name"]: f"on {pack['name']}, cm" for pack in exploration.learned_on}
    held_out = {pack["name"]: f"held out: {pack['name']}, cm" for pack in exploration.held_out_sequences}
    return learned | held_out


def _largest(rows: Iterable[Evaluation]) -> dict[tuple[str, str], float]:
    """The largest error (m) of each configuration and sequence, from repeats if there are any."""
    measured: dict[str, list[Evaluation]] = {}
    for row in rows:
        if row.state == Evaluation.State.DONE:
            measured.setdefault(_identity(row), []).append(row)
    largest: dict[tuple[str, str], float] = {}
    for identity, group in measured.items():
        again = [row for row in group if row.phase == Evaluation.Phase.REPEAT]
        for part in (part for row in again or group for part in row.parts or []):
            key = identity, part["sequence"]
            largest[key] = max(part["ate_max"], largest.get(key, 0.0))
    return largest


def _centimetres(error: float | None) -> str:
    return "" if error is None else f"{error * 100:.2f}"


def _front(exploration: Exploration, rows: Iterable[Evaluation]) -> list[Point]:
    return points.best_points(exploration, points.measured_points(rows))


def _valid(exploration: Exploration, objectives: dict[str, float] | None) -> bool:
    return objectives is not None and all(
        bool(objectives.get(name, float("inf")) <= limit) for name, limit in exploration.limits.items()
    )


def _identity(point: Point | Evaluation) -> str:
    return repr(sorted(point.configuration.items()))


def _written(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _table(head: Sequence[str], lines: Iterable[Sequence[Any]]) -> str:
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join(f"| {' | '.join(map(str, row))} |" for row in rows)
