"""Runtime, error and lost frames of a configuration beside those of the default in its round.

A slow phase of the machine affects both, so that the ratio of runtimes stays the same. On a hard sequence, an
error is only meaningful relative to that of the default. The default is measured first in each round. Ratios
are stored once and never change.
"""

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from statistics import median
from typing import Any

from django.db import transaction
from django.utils import timezone

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.objectives import ERROR_RATIO, LOST_MORE, RATIO
from crowd.explorations.searching.baseline_configurations import DEFAULT
from pareto.errors import ParetoError
from slam.isolated import worst

STEP = 1.5  # from one round to the next: the machine changed, which ratios compensate for and is not noise
LEAST_ERROR = 1e-4  # m: a smaller error of the default counts as this one
State, Phase = Evaluation.State, Evaluation.Phase
COPIED = (Phase.KNOWN, Phase.PRIOR)
DEFAULT_PHASES = (Phase.GIVEN, Phase.DEFAULT, Phase.REPEAT)
Round = tuple[int | None, int, int]  # frames, iteration, number of the default's row for repeats (else -1)


class NoDefaultError(ParetoError):
    """There is no measurement of the default. The message says why and what to do."""


def uses_ratio(exploration: Exploration) -> bool:
    """Whether `exploration` minimises a ratio, and so needs the default in each round."""
    return RATIO in exploration.objectives or ERROR_RATIO in exploration.objectives


def awaits_ratio(exploration: Exploration, row: Evaluation) -> bool:
    """Whether `row` is measured but its ratios are not stored yet."""
    measured = row.state == State.DONE and row.phase not in COPIED
    return measured and row.ratio_filled_at is None and uses_ratio(exploration)


def fill_ratios(exploration: Exploration, rows: Sequence[Evaluation]) -> None:
    """Store the ratios that `rows` (all of `exploration`) allow, also in `rows` themselves.

    A row waits until the default of its round is finished. After storing the others, raises NoDefaultError if
    a row can never have a ratio.
    """
    waiting = [row for row in rows if awaits_ratio(exploration, row)]
    if not waiting:
        return
    computed = compute_ratios(exploration, rows)
    now = timezone.now()
    with transaction.atomic():
        for row in waiting:
            if row.pk in computed:
                row.objectives, row.ratio_filled_at = (row.objectives or {}) | computed[row.pk], now
                stored = Evaluation.objects.filter(pk=row.pk, state=State.DONE, ratio_filled_at__isnull=True)
                stored.update(objectives=row.objectives, ratio_filled_at=now)
    open_frames = {row.frames for row in rows if is_default(row) and row.state in _UNFINISHED}
    for row in waiting:
        if row.pk not in computed and row.frames not in open_frames:
            raise NoDefaultError(_no_default_message(exploration, row.frames))


def compute_ratios(
    exploration: Exploration, rows: Iterable[Evaluation], patient: bool = True
) -> dict[int, dict[str, float]]:
    """Both ratios of each measured row of `exploration`, and `lost_more`, by key; rows without are left out.

    `runtime_ratio`: mean runtime over the median of the default's in the same iteration, over the same frames
    and sequences. For a repeat, the default's repeat at the start of its round counts. If the default failed
    there, the nearest round over as many frames counts. `ate_max_ratio`: the worst over the sequences, as the
    exploration counts errors. `lost_more`: how many frames more than the default it loses on the worst
    sequence, at least 0. `patient`: leave out rows while the default of their round is unfinished.
    """
    rows = sorted((row for row in rows if row.phase not in COPIED), key=lambda row: row.number)
    defaults = [row for row in rows if is_default(row)]
    starts: dict[int, list[int]] = {}
    for row in defaults:
        if row.phase == Phase.REPEAT:
            starts.setdefault(row.iteration, []).append(row.number)
    measured: dict[Round, list[Evaluation]] = {}
    positions: dict[Round, int] = {}
    unfinished: set[Round] = set()
    for row in defaults:
        its_round = _round(row, starts)
        runtime = (row.objectives or {}).get("runtime", 0.0)
        if row.state in _UNFINISHED:
            unfinished.add(its_round)
        elif row.state == State.DONE and runtime > 0:
            measured.setdefault(its_round, []).append(row)
            positions.setdefault(its_round, row.number)
    ratios = {}
    for row in rows:
        its_round = _round(row, starts)
        if row.state != State.DONE or not row.objectives or "runtime" not in row.objectives:
            continue
        if patient and its_round in unfinished:
            continue
        nearest = its_round if its_round in measured else _nearest(row, positions)
        if nearest is not None:
            ratios[row.pk] = _compare(exploration, row, measured[nearest])
    return ratios


def default_rounds(exploration: Exploration, rows: Iterable[Evaluation]) -> list[dict[str, float]]:
    """The default's objectives, and its ratios to the measurement before: they vary by noise alone.

    Where the runtime changed by more than STEP, the pair is left out.
    """
    defaults = sorted((row for row in rows if is_default(row)), key=lambda row: row.number)
    whole = [row for row in defaults if row.state == State.DONE and row.frames == exploration.frames]
    timed = [row for row in whole if (row.objectives or {}).get("runtime", 0.0) > 0]
    compared = [
        (row.objectives or {}) | _compare(exploration, row, [before]) for before, row in pairwise(timed)
    ]
    return [
        each
        for each in compared
        if set(exploration.objectives) <= set(each) and 1 / STEP < each[RATIO] < STEP
    ]


def is_default(row: Evaluation) -> bool:
    """Whether `row` is a measurement of the default that others are compared with."""
    return row.label == DEFAULT and row.phase in DEFAULT_PHASES


def lacks_default(rows: Iterable[Evaluation], repeats: bool) -> bool:
    """Whether `rows`, only their `repeats` or only the others, lack a measurement of the default."""
    kind = [row for row in rows if (row.phase == Phase.REPEAT) == repeats]
    return bool(kind) and not any(is_default(row) for row in kind)


_UNFINISHED = (State.PENDING, State.RUNNING)


def _compare(exploration: Exploration, row: Evaluation, defaults: Sequence[Evaluation]) -> dict[str, float]:
    """Both ratios of `row` to the `defaults` of its round, and `lost_more`, by sequence if all have parts."""
    if row.parts is None or any(default.parts is None for default in defaults):
        by_sequence = {"": row.objectives or {}}
        others = [{"": default.objectives or {}} for default in defaults]
    else:
        by_sequence = _by_sequence(exploration, row)
        others = [_by_sequence(exploration, default) for default in defaults]
        by_sequence = {
            name: by_sequence[name] for name in by_sequence if all(name in other for other in others)
        }
    runtimes = [sum(other[name]["runtime"] for name in by_sequence) for other in others]
    errors = [
        part["ate_max"] / max(median(other[name]["ate_max"] for other in others), LEAST_ERROR)
        for name, part in by_sequence.items()
        if "ate_max" in part and all("ate_max" in other[name] for other in others)
    ]
    ratios = {RATIO: sum(part["runtime"] for part in by_sequence.values()) / median(runtimes)}
    lost = [
        part["lost"] - median(other[name]["lost"] for other in others)
        for name, part in by_sequence.items()
        if "lost" in part
    ]
    if lost:
        ratios[LOST_MORE] = max(0.0, *lost)
    return ratios | ({ERROR_RATIO: worst(errors, exploration.failures_allowed)} if errors else {})


def _by_sequence(exploration: Exploration, row: Evaluation) -> dict[str, dict[str, Any]]:
    """The parts of `row` on sequences learned on, by their names."""
    learned = [pack["name"] for pack in exploration.learned_on]
    return {part["sequence"]: part for part in row.parts or [] if part["sequence"] in learned}


def _round(row: Evaluation, starts: Mapping[int, Sequence[int]]) -> Round:
    if row.phase != Phase.REPEAT:
        return row.frames, row.iteration, -1
    numbers = starts.get(row.iteration, ())
    first = numbers[max(0, bisect_right(numbers, row.number) - 1)] if numbers else -1
    return row.frames, row.iteration, first


def _nearest(row: Evaluation, positions: Mapping[Round, int]) -> Round | None:
    same_frames = [each for each in positions if each[0] == row.frames]
    distances = {each: (abs(positions[each] - row.number), positions[each]) for each in same_frames}
    return min(same_frames, key=distances.__getitem__, default=None)


def _no_default_message(exploration: Exploration, frames: int | None) -> str:
    rows = exploration.evaluations.filter(label=DEFAULT, phase__in=DEFAULT_PHASES, frames=frames)
    failed = rows.filter(state=State.FAILED).order_by("-number").first()
    over = "the whole sequence" if frames is None else f"the first {frames} frames"
    reason = f" ({failed.error})" if failed is not None else ""
    return (
        f"the default configuration could not be measured over {over}{reason}, so {RATIO} is unknown: "
        "measure failures again, then resume"
    )
