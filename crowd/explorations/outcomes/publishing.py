"""Makes a front that clients can measure from an exploration."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from django.utils import timezone
from msgspec.structs import replace

from crowd.explorations import services
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.objectives import RATIO
from crowd.explorations.outcomes import creation_command, exploration_file, robustness
from crowd.explorations.outcomes.one_application import evaluations_of
from crowd.explorations.outcomes.robustness import Robustness
from crowd.explorations.searching import points, search
from crowd.explorations.searching.applications import applications
from crowd.explorations.searching.points import Point
from crowd.fronts import selectors as published
from crowd.fronts import sequences
from crowd.fronts.content.front_file import needs_colour
from crowd.fronts.content.generalisation import objections
from crowd.fronts.content.protocol import ORDERS, session_protocol
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing import services as fronts
from pareto.fronts.front import knee, nondominated
from slam.public_text import without_folders
from wire.front import ADAPTIVE, BEST, DEFAULT, Protocol
from wire.protocol import PAIRS, VALID_BELOW, VERSION

PREDICTED = ("runtime", "ate_max", "ate_mean")
PROTOCOL = Protocol(
    version=VERSION,
    warmup_frames=10,
    frames=100,
    first_counted_frame=10,
    order=ORDERS[0],
    repeats=PAIRS,
    rest_seconds=0,
)
PROBES = 40  # further configurations that clients may be asked to measure
LEAST_VALUE = 1e-9  # m or s: a smaller value counts as this one in ratios
LEAST_REPEATS = 2  # further measurements of a point before its figure is published
NO_COMMAND = "none: it was created in the administration, with the options in `search`"


class NothingToPublishError(ValueError):
    """The exploration has no default, or no valid faster point. The message says which."""


class NotReadyError(ValueError):
    """The chosen points cannot be published yet. The message names them and the remedy."""


REFUSALS = (NotReadyError, NothingToPublishError, *fronts.REFUSALS)


@dataclass(frozen=True)
class Candidate:
    """A point that can be published, with its proposed name (empty: none).

    `edge`: the sequences on which a slight change of depth decides its error.
    """

    point: Point
    name: str
    edge: str = ""

    @property
    def key(self) -> str:
        """The digest of its configuration."""
        return self.point.key

    @property
    def ready(self) -> bool:
        """Whether it was repeated often enough over the whole sequence to be published."""
        return self.point.repeats >= LEAST_REPEATS


class _Measured:
    """What one application of an exploration measured, by default the first."""

    def __init__(self, exploration: Exploration, application: str | None) -> None:
        self.exploration = exploration
        self.application = application or applications(exploration)[0]
        self.evaluations = evaluations_of(exploration, self.application, exploration.evaluations.all())
        self.points = points.measured_points(self.evaluations)
        self.robust = robustness.repeat_robustness(exploration, self.evaluations)


def candidates(exploration: Exploration, application: str | None = None) -> tuple[tuple[Candidate, ...], str]:
    """The points that can be published, named ones first, then by runtime; and why none has a name, if so.

    They are the known configurations, the front of the search, that of measurements over the whole sequence,
    and all repeated points, of `application`: by default the first of `exploration`.
    """
    measured = _Measured(exploration, application)
    try:
        named, reason = name_points(measured.points, measured.robust, measured.application), ""
    except NothingToPublishError as error:
        named, reason = {}, str(error)
    names = {point.key: name for name, point in named.items()}
    fronts_of = (measured.points, points.searched_points(exploration, measured.evaluations))
    front = {point.key for kind in fronts_of for point in points.best_points(exploration, kind)}
    rows = [
        Candidate(point, names.get(point.key, ""), _edge(point, measured.robust)) for point in measured.points
    ]
    shown = [row for row in rows if row.name or row.point.label or row.point.repeats or row.key in front]
    order = {name: position for position, name in enumerate(named)}
    shown.sort(key=lambda row: (order.get(row.name, len(order)), row.point.values["runtime"]))
    return tuple(shown), reason


def measure_again(exploration: Exploration, keys: Iterable[str], times: int) -> list[Evaluation]:
    """Measure the points `keys` `times` more, in turn and over the whole sequence.

    Raises ValidationError if the exploration cannot continue, or if no such point was measured.
    """
    evaluations = list(exploration.evaluations.all())
    stored = {row.pk: row for row in evaluations}
    first: dict[str, Evaluation] = {}  # of the configurations that are one point, the first measured
    for application in applications(exploration):
        for row in evaluations_of(exploration, application, evaluations):
            if row.state == Evaluation.State.DONE and row.phase != Evaluation.Phase.PRIOR:
                first.setdefault(row.configuration_key, stored[row.pk])
    chosen = [first[key] for key in keys if key in first]
    labels = {row.configuration_key: row.label for row in evaluations if row.label}
    return services.measure_again(
        exploration, [(row.configuration, labels.get(row.configuration_key, "")) for row in chosen], times
    )


def create_draft(
    exploration: Exploration, names: Mapping[str, str], by: str, application: str | None = None
) -> FrontVersion:
    """Create a draft of the next front of `application`, by default the first of `exploration`.

    `names`: names of its points by key.

    Raises NotReadyError if a point was not repeated often enough or `best` is not valid, and what
    crowd.fronts.publishing.services.create_draft raises.
    """
    measured = _Measured(exploration, application)
    by_key = {point.key: point for point in measured.points}
    if missing := [name for key, name in names.items() if key not in by_key]:
        raise NotReadyError(f"{', '.join(missing)}: no such configuration was measured")
    chosen = [(name, by_key[key]) for key, name in names.items()]
    if once := [name for name, point in chosen if point.repeats < LEAST_REPEATS]:
        raise NotReadyError(
            f"{', '.join(once)}: repeated fewer than {LEAST_REPEATS} times, so the figure is not reliable: "
            "measure the named points again first"
        )
    default = next((point for name, point in chosen if name == DEFAULT), None)
    for name, point in chosen:
        if name in (BEST, ADAPTIVE) and (reasons := _objections(point, default, measured.robust)):
            raise NotReadyError(f"{name}: {'; '.join(reasons)}")
    version = published.next_version(measured.application)
    # A dictionary would hide a duplicate name; the check of the front reports it.
    return fronts.create_draft(_document(measured, version, chosen), by, f"from exploration {exploration.pk}")


def front_document(exploration: Exploration, version: str, application: str | None = None) -> dict[str, Any]:
    """The exploration's front for `application`, by default its first, in the format of a front file.

    Only points that were repeated LEAST_REPEATS times are included, as in a draft. Raises
    NothingToPublishError without such points, without the default, or without a valid faster point, and
    SequenceError if the sequence is not on this machine any more.
    """
    measured = _Measured(exploration, application)
    ready = [point for point in measured.points if point.repeats >= LEAST_REPEATS]
    if not ready:
        raise NothingToPublishError(
            f"no configuration was repeated {LEAST_REPEATS} times over the whole sequence, so no figure is "
            "reliable: explore with at least as many repeats, or measure the points again in the "
            "administration"
        )
    chosen = name_points(ready, measured.robust, measured.application)
    return _document(measured, version, list(chosen.items()))


def name_points(
    measured: Sequence[Point], robust: Mapping[str, Robustness], application: str = ""
) -> dict[str, Point]:
    """The points to publish by name: default, best, adaptive, accurate, knee, known ones, rest of the front.

    `best`: the fastest point without `crowd.fronts.content.generalisation.objections` that computes every
    frame; `adaptive`: the fastest such point that leaves out frames, if there is one. `accurate`: the valid
    point with the smallest maximum error. `knee`: the best compromise between error and speed. Points on an
    edge are excluded, and so are those that are invalid or lose the camera more often than the default. If
    any point was repeated, only repeated ones count: a single measurement may be luck. Measurements over a
    part of the sequence never count. `robust`: the robustness by the key of the configuration.
    """
    finished = [point for point in measured if not point.censored]
    again = [point for point in finished if point.repeats] or [point for point in finished if point.whole]
    default = points.default_point(again)
    if default is None:
        raise NothingToPublishError(
            "the default configuration was not measured over the whole sequence: there is nothing to "
            "compare with"
        )
    speed = points.speed_objective(again)
    valid = sorted(
        (point for point in again if _holds(point, robust)),
        key=lambda point: point.values[speed],
    )
    faster = [point for point in valid if point.values[speed] < default.values[speed]]
    if not faster:
        raise NothingToPublishError(
            "no configuration that keeps its error below 5 cm, whatever rounding does, is faster than the "
            "default"
        )
    reasons = [_objections(point, default, robust) for point in faster]
    possible = [point for point, why in zip(faster, reasons, strict=True) if not why]
    best = next((point for point in possible if not points.skips(application, point)), None)
    if best is None:
        why = "; ".join(reasons[-1]) or "those that hold leave out frames"
        raise NothingToPublishError(f"no configuration may be called {BEST}: {why}")
    table = np.array([[_worst_error(point), point.values[speed]] for point in valid])
    on_front = [point for point, keep in zip(valid, nondominated(table), strict=True) if keep]
    named = {DEFAULT: default, BEST: best}
    if adaptive := [point for point in possible if points.skips(application, point)]:
        named[ADAPTIVE] = adaptive[0]
    for name, point in (("accurate", min(valid, key=_worst_error)), ("knee", valid[knee(table)])):
        if point not in named.values():
            named[name] = point
    named |= {point.label: point for point in valid if point.label and point not in named.values()}
    others = [point for point in on_front if point not in named.values()]
    return named | {f"front-{number:02}": point for number, point in enumerate(others, start=1)}


def _holds(point: Point, robust: Mapping[str, Robustness]) -> bool:
    """Whether `point` is valid in every measurement, on no edge, and loses no more frames than the
    default."""
    return _worst_error(point) < VALID_BELOW and not point.loses and not _edge(point, robust)


def _worst_error(point: Point) -> float:
    """The largest error (m) of `point`'s measurements."""
    return point.high["ate_max"]


def _edge(point: Point, robust: Mapping[str, Robustness]) -> str:
    return robust[point.key].edge if point.key in robust else ""


def _objections(point: Point, default: Point | None, robust: Mapping[str, Robustness]) -> list[str]:
    """Why `point` cannot be `best`, compared with `default`; empty if it can."""
    tested = robust.get(point.key)
    beside = robust.get(default.key) if default else None
    reasons: list[str] = []
    if edge := _edge(point, robust):
        reasons.append(f"a slight change of the depth decides its error on {edge}")
    if tested is not None and beside is not None:
        reasons += objections(tested.results, beside.results, VALID_BELOW)
    error = _worst_error(point)
    # Over a single sequence there are no results by sequence.
    if not reasons and not error < VALID_BELOW:
        reasons.append(f"its error of {100 * error:.1f} cm is not below {100 * VALID_BELOW:g} cm")
    return reasons


def _document(measured: _Measured, version: str, chosen: Sequence[tuple[str, Point]]) -> dict[str, Any]:
    """`chosen`, points by name, as a front file."""
    exploration, robust = measured.exploration, measured.robust
    colour = needs_colour(measured.application)
    sequence = sequences.find_verified(exploration.sequence, exploration.sequence_sha256, colour)
    published_points = [point for _, point in chosen]
    probes = _probes(measured, published_points)
    protocol = session_protocol(PROTOCOL, [name for name, _ in chosen])
    protocol = replace(protocol, frames=min(protocol.frames, sequence["frames"]))
    return {
        "application": measured.application,
        "version": version,
        "protocol": msgspec.to_builtins(protocol),
        "sequence": _pack_name(sequence),
        "configurations": [_front_row(name, point, robust.get(point.key)) for name, point in chosen],
        "provenance": _provenance(exploration, measured.evaluations, published_points),
        **({"probes": probes} if probes else {}),
    }


def _pack_name(sequence: Mapping[str, Any]) -> dict[str, str]:
    """What a front file says of the pack that `sequence` describes."""
    colour = {"colour_sha256": sequence["colour"]["sha256"]} if "colour" in sequence else {}
    return {name: sequence[name] for name in ("name", "sha256")} | colour


def _front_row(name: str, point: Point, robust: Robustness | None) -> dict[str, Any]:
    """`point` as a row of a front file, with its results by sequence."""
    results = {} if robust is None else robust.results._asdict()
    return {
        "name": name,
        "parameters": point.configuration,
        "predicted": _predicted(point),
        **{member: msgspec.to_builtins(list(rows)) for member, rows in results.items() if rows},
    }


def _probes(measured: _Measured, chosen: Sequence[Point]) -> list[dict[str, Any]]:
    """At most PROBES points near the front, which clients may be asked to measure, fastest first.

    They are the valid points nearest to the front of `chosen`, by how many times slower or less accurate they
    are.
    """
    whole = [row for row in measured.evaluations if row.frames is None and not row.censored]
    keys = {point.key for point in chosen}
    every = [
        point
        for point in points.measured_points(whole)
        if point.key not in keys and _holds(point, measured.robust)
    ]
    speed = points.speed_objective([*chosen, *every])

    def logs(point: Point) -> np.ndarray:
        return np.log([max(point.values[name], LEAST_VALUE) for name in ("ate_max", speed)])

    front = np.array([logs(point) for point in chosen])
    behind = [float((logs(point) - front).max(axis=1).min()) for point in every]
    nearest = [every[index] for index in np.argsort(behind, kind="stable")[:PROBES]]
    nearest.sort(key=lambda point: point.values[speed])
    return [_front_row(f"probe-{number:02}", point, None) for number, point in enumerate(nearest, start=1)]


def _predicted(point: Point) -> dict[str, float]:
    """The medians of `point`, and the ranges of its runtimes and runtime ratios."""
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
    measured_here = [evaluation for evaluation in evaluations if evaluation.phase not in search.COPIED]
    done = [evaluation for evaluation in measured_here if evaluation.state == Evaluation.State.DONE]
    failed = [evaluation for evaluation in measured_here if evaluation.state == Evaluation.State.FAILED]
    warm = len(measured_here) < len(evaluations)
    repeats = [point.measurements for point in chosen]
    sha256 = exploration_file.digest(exploration, list(exploration.evaluations.all()))
    # Pages of the front find the exploration by it.
    Exploration.objects.filter(pk=exploration.pk).update(sha256=sha256)
    return {
        "device": _all_values(done, "name"),
        "driver": _all_values(done, "driver"),
        "platform": _all_values(done, "platform"),
        "reference_device": exploration.reference_device.name,
        "date": (exploration.finished_at or timezone.now()).date().isoformat(),
        "software": ", ".join(sorted({evaluation.software for evaluation in done})),
        "sequence_sha256": exploration.sequence_sha256,
        "sequences": exploration.learned_on,
        "held_out": exploration.held_out_sequences,
        "protocol": (
            "each measurement is a fresh process; runtime is the mean computation time of frames 10 and "
            "later; published values are medians over measurements of the whole sequence made in turn, "
            f"{_range(repeats)} of each point{_ratio_text(chosen)}{_error_text(exploration)}"
        ),
        "exploration": {"sha256": sha256},
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
        **({"warm_start": f"exploration {exploration.warm_start_from_id}"} if warm else {}),
        "command": without_folders(exploration.command)
        or creation_command.creation_command(exploration)
        or NO_COMMAND,
    }


def _ratio_text(chosen: Sequence[Point]) -> str:
    if points.speed_objective(chosen) != RATIO:
        return ""
    return f"; {RATIO} is the runtime over that of the default in the same round"


def _error_text(exploration: Exploration) -> str:
    """How errors of several sequences are combined."""
    if not exploration.further_sequences:
        return ""
    which = "the worst" if exploration.error_quantile == 1 else f"quantile {exploration.error_quantile:g}"
    return (
        f"; errors are {which} over the sequences and runtimes their mean; after the first measurement of a "
        "point each depth was changed by one unit, otherwise each time, and results by sequence are the "
        "worst of these"
    )


def _all_values(done: Iterable[Evaluation], member: str) -> str | None:
    """The distinct values of `member` in the descriptions of the devices; None without any."""
    said = {str(row.device[member]) for row in done if row.device and row.device.get(member)}
    return ", ".join(sorted(said)) or None


def _range(numbers: Sequence[int]) -> str:
    return str(min(numbers)) if min(numbers) == max(numbers) else f"{min(numbers)} to {max(numbers)}"
