"""From an exploration to a front that clients measure."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from django.utils import timezone

from crowd.explorations import services
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.objectives import RATIO
from crowd.explorations.outcomes import creation_command, robustness
from crowd.explorations.outcomes.robustness import Robustness
from crowd.explorations.searching import batches, points, search
from crowd.explorations.searching.points import Point
from crowd.fronts import selectors as published
from crowd.fronts import sequences
from crowd.fronts.content.front_file import needs_colour
from crowd.fronts.content.generalisation import objections
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing import services as fronts
from crowd.fronts.selectors import BEST, DEFAULT
from pareto.fronts.front import knee, nondominated
from slam.protocol import VALID_BELOW
from slam.public_text import without_folders

PREDICTED = ("runtime", "ate_max", "ate_mean")
PROTOCOL: dict[str, Any] = {
    "version": 1,
    "warmup_frames": 10,
    "frames": 100,
    "first_counted_frame": 10,
    "order": ["default", "best", "best", "default"],
    "repeats": 2,
    "rest_seconds": 0,
    "max_ate": VALID_BELOW,
}
PROBES = 40  # configurations beside the front that clients may be asked to measure
TINY = 1e-9  # m or s: a smaller value counts as this one in ratios
LEAST_REPEATS = 2  # further measurements of a point before its figure is published
UNSPOKEN = "none: it was created in the administration, with what `search` says"


class NothingToPublishError(ValueError):
    """An exploration that has no default, or nothing valid that is faster; the message says which."""


class NotReadyError(ValueError):
    """A choice of points that cannot be published yet; the message names them and the remedy."""


REFUSALS = (NotReadyError, NothingToPublishError, *fronts.REFUSALS)


@dataclass(frozen=True)
class Candidate:
    """A point that may be published: its digest, and the name that it would get (empty: none).

    `edge` names sequences on which a slight change of the depth decides its error.
    """

    key: str
    point: Point
    name: str
    edge: str = ""

    @property
    def ready(self) -> bool:
        """Whether it was measured often enough, over the whole sequence, for a figure to be published."""
        return self.point.repeats >= LEAST_REPEATS


def candidates(exploration: Exploration) -> tuple[tuple[Candidate, ...], str]:
    """What could be published, the named first, then by runtime; and why nothing has a name, if so.

    These are the known configurations, the front of the search and that of what was measured over the whole
    sequence, and whatever was measured again.
    """
    evaluations = list(exploration.evaluations.all())
    measured = points.measured(evaluations)
    found_robust = robustness.of_repeats(exploration, evaluations)
    try:
        named, reason = name_points(measured, found_robust), ""
    except NothingToPublishError as error:
        named, reason = {}, str(error)
    names = {batches.key(point.configuration): name for name, point in named.items()}
    fronts_of = (measured, points.searched(exploration, evaluations))
    front = {
        batches.key(point.configuration) for kind in fronts_of for point in points.front(exploration, kind)
    }
    found = [
        Candidate(key, point, names.get(key, ""), found_robust[key].edge if key in found_robust else "")
        for key, point in _keyed(measured).items()
    ]
    shown = [row for row in found if row.name or row.point.label or row.point.repeats or row.key in front]
    order = {name: place for place, name in enumerate(named)}
    shown.sort(key=lambda row: (order.get(row.name, len(order)), row.point.values["runtime"]))
    return tuple(shown), reason


def measure_again(exploration: Exploration, keys: Iterable[str], times: int) -> list[Evaluation]:
    """Ask for the points with these KEYS TIMES more, in turn and over the whole sequence.

    Raises ValidationError where the exploration cannot go on, or no such point was measured.
    """
    measured = _keyed(points.measured(exploration.evaluations.all()))
    chosen = [measured[key] for key in keys if key in measured]
    return services.measure_again(
        exploration, [(point.configuration, point.label) for point in chosen], times
    )


def draft(exploration: Exploration, names: Mapping[str, str], by: str) -> FrontVersion:
    """A draft of its application's next version with the points that NAMES names by their keys.

    Raises NotReadyError where a point was not measured again often enough, or `best` is not valid, and what
    crowd.fronts.publishing.services.create_draft raises.
    """
    evaluations = list(exploration.evaluations.all())
    found = _keyed(points.measured(evaluations))
    if missing := [name for key, name in names.items() if key not in found]:
        raise NotReadyError(f"{', '.join(missing)}: no such configuration was measured")
    chosen = [(name, found[key]) for key, name in names.items()]
    if once := [name for name, point in chosen if point.repeats < LEAST_REPEATS]:
        raise NotReadyError(
            f"{', '.join(once)}: measured again fewer than {LEAST_REPEATS} times, so nobody knows how far "
            "the figure can be trusted: measure the named points again first"
        )
    robust = robustness.of_repeats(exploration, evaluations)
    default = next((point for name, point in chosen if name == DEFAULT), None)
    for name, point in chosen:
        if name == BEST and (reasons := _objections(point, default, robust)):
            raise NotReadyError(f"{BEST}: {'; '.join(reasons)}")
    version = published.next_version(exploration.application)
    # A dictionary would hide a name that is given twice; the check of the front reports it.
    content = _document(exploration, version, evaluations, chosen)
    return fronts.create_draft(content, by, f"from exploration {exploration.pk}")


def document(exploration: Exploration, version: str) -> dict[str, Any]:
    """The exploration's front in the shape of a front file; no figure in it is anybody's opinion.

    Only points that were measured again LEAST_REPEATS times take part, as in a draft. Raises
    NothingToPublishError where none was, there is no default among them, or nothing valid is faster than it,
    and SequenceError where the sequence is not here any more.
    """
    evaluations = list(exploration.evaluations.all())
    ready = [point for point in points.measured(evaluations) if point.repeats >= LEAST_REPEATS]
    if not ready:
        raise NothingToPublishError(
            f"no configuration was measured again {LEAST_REPEATS} times over the whole sequence, so nobody "
            "knows how far a figure can be trusted: explore with as many repeats, or measure the points "
            "again in the administration"
        )
    chosen = name_points(ready, robustness.of_repeats(exploration, evaluations))
    return _document(exploration, version, evaluations, list(chosen.items()))


def name_points(measured: Sequence[Point], robust: Mapping[str, Robustness]) -> dict[str, Point]:
    """What is published, by name: default, best, accurate, knee, the other known ones, the rest of the front.

    `best` is the fastest point that `crowd.fronts.content.generalisation.objections` says nothing about.
    `accurate` is the valid one with the least maximal error, `knee` the best compromise between error and
    speed. Points on an edge take no part, and invalid ones only as the default. Where any point was measured
    again, only those that were take part: a single lucky measurement makes no front. Neither does one over a
    part of the sequence. ROBUST is what the repeats say, by the key of the configuration.
    """
    known = [point for point in measured if not point.censored]
    again = [point for point in known if point.repeats] or [point for point in known if point.whole]
    default = points.default(again)
    if default is None:
        raise NothingToPublishError(
            "the default configuration was not measured over the whole sequence: there is nothing to "
            "compare with"
        )
    speed = points.speed_objective(again)
    valid = sorted(
        (point for point in again if _worst_error(point) < VALID_BELOW and not _edge(point, robust)),
        key=lambda point: point.values[speed],
    )
    faster = [point for point in valid if point.values[speed] < default.values[speed]]
    if not faster:
        raise NothingToPublishError(
            "no configuration that keeps its error below 5 cm, whatever rounding does, is faster than the "
            "default"
        )
    reasons = [_objections(point, default, robust) for point in faster]
    best = next((point for point, why in zip(faster, reasons, strict=True) if not why), None)
    if best is None:
        raise NothingToPublishError(f"no configuration may be called {BEST}: {'; '.join(reasons[-1])}")
    table = np.array([[_worst_error(point), point.values[speed]] for point in valid])
    on_front = [point for point, keep in zip(valid, nondominated(table), strict=True) if keep]
    named = {DEFAULT: default, BEST: best}
    for name, point in (
        ("accurate", min(valid, key=_worst_error)),
        ("knee", valid[knee(table)]),
    ):
        if point not in named.values():
            named[name] = point
    named |= {point.label: point for point in valid if point.label and point not in named.values()}
    others = [point for point in on_front if point not in named.values()]
    return named | {f"front-{number:02}": point for number, point in enumerate(others, start=1)}


def _worst_error(point: Point) -> float:
    """The largest error (m) of all its measurements."""
    return point.high["ate_max"]


def _edge(point: Point, robust: Mapping[str, Robustness]) -> str:
    found = robust.get(batches.key(point.configuration))
    return found.edge if found else ""


def _objections(point: Point, default: Point | None, robust: Mapping[str, Robustness]) -> list[str]:
    """Why POINT may not be called best beside DEFAULT; empty where it may."""
    own = robust.get(batches.key(point.configuration))
    beside = robust.get(batches.key(default.configuration)) if default else None
    found: list[str] = []
    if own is not None and own.edge:
        found.append(f"a slight change of the depth decides its error on {own.edge}")
    if own is not None and beside is not None:
        found += objections(own.results, beside.results, VALID_BELOW)
    error = _worst_error(point)
    # A former program measured without results by sequence.
    if not found and not error < VALID_BELOW:
        found.append(f"its error of {100 * error:.1f} cm is not below {100 * VALID_BELOW:g} cm")
    return found


def _keyed(measured: Iterable[Point]) -> dict[str, Point]:
    return {batches.key(point.configuration): point for point in measured}


def _document(
    exploration: Exploration,
    version: str,
    evaluations: Sequence[Evaluation],
    chosen: Sequence[tuple[str, Point]],
) -> dict[str, Any]:
    colour = needs_colour(exploration.application)
    sequence = sequences.find_verified(exploration.sequence, exploration.sequence_sha256, colour)
    robust = robustness.of_repeats(exploration, evaluations)
    probes = _probes(evaluations, [point for _, point in chosen], robust)
    return {
        "application": exploration.application,
        "version": version,
        "protocol": PROTOCOL | {"frames": min(PROTOCOL["frames"], sequence["frames"])},
        "sequence": published.sequence_reference(sequence),
        "configurations": [
            _described(name, point, robust.get(batches.key(point.configuration))) for name, point in chosen
        ],
        "provenance": _provenance(exploration, evaluations, [point for _, point in chosen]),
        **({"probes": probes} if probes else {}),
    }


def _described(name: str, point: Point, robust: Robustness | None) -> dict[str, Any]:
    """POINT as a front's file has it, with its results by sequence where there are several."""
    results = {} if robust is None else robust.results._asdict()
    return {
        "name": name,
        "parameters": point.configuration,
        "predicted": _predicted(point),
        **{member: list(found) for member, found in results.items() if found},
    }


def _probes(
    evaluations: Sequence[Evaluation], chosen: Sequence[Point], robust: Mapping[str, Robustness]
) -> list[dict[str, Any]]:
    """The front's neighbourhood, for clients that are asked to measure more: up to PROBES points.

    They are the valid ones nearest to the front of CHOSEN, by how many times they are slower or less exact,
    and come in the order of their speed.
    """
    whole = [row for row in evaluations if row.frames is None and not row.censored]
    known = {batches.key(point.configuration) for point in chosen}
    every = [
        point
        for key, point in _keyed(points.measured(whole)).items()
        if key not in known and _worst_error(point) < VALID_BELOW and not _edge(point, robust)
    ]
    speed = points.speed_objective([*chosen, *every])
    objectives = ("ate_max", speed)
    front = np.log([[max(point.values[name], TINY) for name in objectives] for point in chosen])
    behind = [
        float((np.log([max(point.values[name], TINY) for name in objectives]) - front).max(axis=1).min())
        for point in every
    ]
    nearest = [every[place] for place in np.argsort(behind, kind="stable")[:PROBES]]
    nearest.sort(key=lambda point: point.values[speed])
    return [_described(f"probe-{number:02}", point, None) for number, point in enumerate(nearest, start=1)]


def _predicted(point: Point) -> dict[str, float]:
    """Medians, and between which runtimes, and ratios to the default's, the measurements lay."""
    names = [name for name in ("runtime", RATIO) if name in point.values]
    return (
        {name: point.values[name] for name in dict.fromkeys((*PREDICTED, *names))}
        | {f"{name}_low": point.low[name] for name in names}
        | {f"{name}_high": point.high[name] for name in names}
        | {"measurements": point.measurements}
    )


def _provenance(
    exploration: Exploration, evaluations: Sequence[Evaluation], chosen: Sequence[Point]
) -> dict[str, Any]:
    own = [evaluation for evaluation in evaluations if evaluation.phase not in search.COPIED]
    done = [evaluation for evaluation in own if evaluation.state == Evaluation.State.DONE]
    failed = [evaluation for evaluation in own if evaluation.state == Evaluation.State.FAILED]
    warm_start = (
        {"warm_start": f"exploration {exploration.warm_start_from_id}"} if len(own) < len(evaluations) else {}
    )
    repeats = [point.measurements for point in chosen]
    return {
        "device": _every(done, "name"),
        "driver": _every(done, "driver"),
        "platform": _every(done, "platform"),
        "reference_device": exploration.reference_device.name,
        "date": (exploration.finished_at or timezone.now()).date().isoformat(),
        "software": ", ".join(sorted({evaluation.software for evaluation in done})),
        "sequence_sha256": exploration.sequence_sha256,
        "sequences": exploration.learned_on,
        "held_out": exploration.held_out_sequences,
        "protocol": (
            "each measurement is a fresh process; runtime is the mean computation time of frames 10 and "
            "later; published values are medians over measurements of the whole sequence made in turn, "
            f"{_range(repeats)} of each point{_compared(chosen)}{_judged(exploration)}"
        ),
        "evaluations": len(done) + len(failed),
        "failed": len(failed),
        "invalid": sum(
            evaluation.objectives["ate_max"] >= VALID_BELOW for evaluation in done if evaluation.objectives
        ),
        "search": {
            "method": exploration.method,
            "seed": exploration.seed,
            "budget": exploration.budget,
            "batch": exploration.batch,
            "objectives": exploration.objectives,
            "limits": exploration.limits,
            "space": exploration.space.get("name"),
            "frames": exploration.frames or "all",
        },
        **warm_start,
        "command": without_folders(exploration.command) or creation_command.command(exploration) or UNSPOKEN,
    }


def _compared(chosen: Sequence[Point]) -> str:
    if points.speed_objective(chosen) != RATIO:
        return ""
    return f"; {RATIO} is the runtime over that of the default in the same round"


def _judged(exploration: Exploration) -> str:
    """How errors of several sequences become one."""
    if not exploration.further_sequences:
        return ""
    which = "the worst" if exploration.error_quantile == 1 else f"quantile {exploration.error_quantile:g}"
    return (
        f"; errors are {which} over the sequences and runtimes their mean; after the first measurement of a "
        "point each depth was changed by one unit, otherwise each time, and results by sequence are the "
        "worst of these"
    )


def _every(done: Iterable[Evaluation], member: str) -> str | None:
    """What the devices that measured say of themselves, each once; None where none says it."""
    said = {str(row.device[member]) for row in done if row.device and row.device.get(member)}
    return ", ".join(sorted(said)) or None


def _range(numbers: Sequence[int]) -> str:
    return str(min(numbers)) if min(numbers) == max(numbers) else f"{min(numbers)} to {max(numbers)}"
