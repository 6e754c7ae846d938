"""runtime_ratio and ate_max_ratio: a configuration's runtime and error over the default's in the same round.

A slow hour of a host slows both alike, so that the ratio of runtimes stays as it is. On a sequence that is
hard for the default, too, an error means little without that of the default. The default is measured first
in each round. Ratios are stored once and never change afterwards.
"""

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from statistics import median
from typing import Any, Protocol, TypeVar

from django.db import transaction
from django.utils import timezone

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.objectives import ERROR_RATIO, RATIO
from crowd.explorations.searching.baseline_configurations import DEFAULT
from pareto.errors import ParetoError
from slam.isolated import worst

LEAST_ERROR = 1e-4  # m: a smaller error of the default counts as this one
State, Phase = Evaluation.State, Evaluation.Phase
COPIED = (Phase.KNOWN, Phase.PRIOR)
DEFAULT_PHASES = (Phase.GIVEN, Phase.DEFAULT, Phase.REPEAT)
Round = tuple[int | None, int, int]  # frames, iteration, number of the default's row for repeats (else -1)


class NoDefaultError(ParetoError):
    """No measurement of the default to compare with; the message says why and what to do."""


class Measured(Protocol):
    """What a ratio is computed from: an evaluation, or a row of its columns."""

    @property
    def pk(self) -> int: ...
    @property
    def number(self) -> int: ...
    @property
    def phase(self) -> str: ...
    @property
    def label(self) -> str: ...
    @property
    def state(self) -> str: ...
    @property
    def iteration(self) -> int: ...
    @property
    def frames(self) -> int | None: ...
    @property
    def objectives(self) -> dict[str, float] | None: ...
    @property
    def parts(self) -> list[dict[str, Any]] | None: ...
    @property
    def ratio_filled_at(self) -> datetime | None: ...


RowType = TypeVar("RowType", bound=Measured)


def used(exploration: Exploration) -> bool:
    """Whether EXPLORATION minimises a ratio, and so measures the default in each round."""
    return RATIO in exploration.objectives or ERROR_RATIO in exploration.objectives


def awaits(exploration: Exploration, row: Measured) -> bool:
    """Whether ROW is measured but not comparable yet: its ratio is not filled in."""
    measured = row.state == State.DONE and row.phase not in COPIED
    return measured and row.ratio_filled_at is None and used(exploration)


def fill(exploration: Exploration, rows: Sequence[RowType]) -> dict[int, dict[str, float]]:
    """Store the ratios that ROWS, all of the exploration, allow now; the new objectives by key.

    A row waits while the default of its round is being measured. Raises NoDefaultError where a row can never
    have a ratio, after the others are stored.
    """
    waiting = [row for row in rows if awaits(exploration, row)]
    if not waiting:
        return {}
    found = ratios(exploration, rows)
    filled = {row.pk: (row.objectives or {}) | found[row.pk] for row in waiting if row.pk in found}
    now = timezone.now()
    with transaction.atomic():
        for key, objectives in filled.items():
            stored = Evaluation.objects.filter(pk=key, state=State.DONE, ratio_filled_at__isnull=True)
            stored.update(objectives=objectives, ratio_filled_at=now)
    open_frames = {row.frames for row in rows if is_default(row) and row.state in _UNFINISHED}
    for row in waiting:
        if row.pk not in filled and row.frames not in open_frames:
            raise NoDefaultError(_complaint(exploration, row.frames))
    return filled


def ratios(
    exploration: Exploration, rows: Iterable[Measured], patient: bool = True
) -> dict[int, dict[str, float]]:
    """Both ratios of each measured row of EXPLORATION, by its key; rows without them are left out.

    `runtime_ratio` is the mean runtime over the median of the default's in the same iteration and over as
    many frames, both of the sequences that the row ran, for a repeat over the default's repeat that began its
    round. Where the default failed there, the nearest round over as many frames counts. `ate_max_ratio` is
    the worst over the sequences, as the exploration counts errors. A PATIENT caller gets no ratio while the
    default of a row's own round is unfinished.
    """
    rows = sorted((row for row in rows if row.phase not in COPIED), key=lambda row: row.number)
    defaults = [row for row in rows if is_default(row)]
    starts: dict[int, list[int]] = {}
    for row in defaults:
        if row.phase == Phase.REPEAT:
            starts.setdefault(row.iteration, []).append(row.number)
    measured: dict[Round, list[Measured]] = {}
    positions: dict[Round, int] = {}
    unfinished: set[Round] = set()
    for row in defaults:
        place = _round(row, starts)
        runtime = (row.objectives or {}).get("runtime", 0.0)
        if row.state in _UNFINISHED:
            unfinished.add(place)
        elif row.state == State.DONE and runtime > 0:
            measured.setdefault(place, []).append(row)
            positions.setdefault(place, row.number)
    found = {}
    for row in rows:
        place = _round(row, starts)
        if row.state != State.DONE or not row.objectives or "runtime" not in row.objectives:
            continue
        if patient and place in unfinished:
            continue
        nearest = place if place in measured else _nearest(row, positions)
        if nearest is not None:
            found[row.pk] = _compare(exploration, row, measured[nearest])
    return found


def is_default(row: Measured) -> bool:
    """Whether ROW measures the default for others to be compared with."""
    return row.label == DEFAULT and row.phase in DEFAULT_PHASES


def lacks_default(rows: Iterable[Measured], repeats: bool) -> bool:
    """Whether ROWS are measured in one round without the default; of these its REPEATS or all others."""
    kind = [row for row in rows if (row.phase == Phase.REPEAT) == repeats]
    return bool(kind) and not any(is_default(row) for row in kind)


_UNFINISHED = (State.PENDING, State.RUNNING)


def _compare(exploration: Exploration, row: Measured, defaults: Sequence[Measured]) -> dict[str, float]:
    """Both ratios of ROW to the DEFAULTS of its round, by sequence where all tell of these."""
    if row.parts is None or any(default.parts is None for default in defaults):
        own = {"": row.objectives or {}}
        others = [{"": default.objectives or {}} for default in defaults]
    else:
        own = _by_sequence(exploration, row)
        others = [_by_sequence(exploration, default) for default in defaults]
        own = {name: own[name] for name in own if all(name in other for other in others)}
    runtimes = [sum(other[name]["runtime"] for name in own) for other in others]
    errors = [
        part["ate_max"] / max(median(other[name]["ate_max"] for other in others), LEAST_ERROR)
        for name, part in own.items()
        if "ate_max" in part and all("ate_max" in other[name] for other in others)
    ]
    found = {RATIO: sum(part["runtime"] for part in own.values()) / median(runtimes)}
    return found | ({ERROR_RATIO: worst(errors, exploration.failures_allowed)} if errors else {})


def _by_sequence(exploration: Exploration, row: Measured) -> dict[str, dict[str, Any]]:
    """The parts of ROW on sequences learned on, by their names."""
    learned = [pack["name"] for pack in exploration.learned_on]
    return {part["sequence"]: part for part in row.parts or [] if part["sequence"] in learned}


def _round(row: Measured, starts: Mapping[int, Sequence[int]]) -> Round:
    if row.phase != Phase.REPEAT:
        return row.frames, row.iteration, -1
    numbers = starts.get(row.iteration, ())
    first = numbers[max(0, bisect_right(numbers, row.number) - 1)] if numbers else -1
    return row.frames, row.iteration, first


def _nearest(row: Measured, positions: Mapping[Round, int]) -> Round | None:
    alike = [place for place in positions if place[0] == row.frames]
    distances = {place: (abs(positions[place] - row.number), positions[place]) for place in alike}
    return min(alike, key=distances.__getitem__, default=None)


def _complaint(exploration: Exploration, frames: int | None) -> str:
    rows = exploration.evaluations.filter(label=DEFAULT, phase__in=DEFAULT_PHASES, frames=frames)
    failed = rows.filter(state=State.FAILED).order_by("-number").first()
    over = "the whole sequence" if frames is None else f"the first {frames} frames"
    reason = f" ({failed.error})" if failed is not None else ""
    return (
        f"the default configuration could not be measured over {over}{reason}, so that no {RATIO} is known: "
        "measure failures once more, then resume"
    )
