"""Estimates how long a new exploration will take.

The time per frame comes from earlier measurements of the same system on the same device and backend, over any
sequence. Without them, a front of that device gives the computation time only. Otherwise it is unknown.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil
from statistics import fmean

from crowd.explorations.measuring.measurement import sequence_names
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.searching import baseline_configurations, ratios, search
from crowd.explorations.searching.baseline_configurations import DEFAULT
from crowd.explorations.searching.search import COPIED
from crowd.fronts import selectors, sequences

RECENT_MEASUREMENTS = 200  # measurements in the mean time per frame
Frames = Mapping[tuple[str, str], int]  # by name and digest of a pack


@dataclass(frozen=True)
class Part:
    """Measurements of `frames` each. `seconds`: their time on one machine; None if unknown."""

    title: str
    measurements: int
    frames: int
    seconds: float | None


@dataclass(frozen=True)
class Estimate:
    """What is measured, how long it takes on `machines` in parallel, and the source of the estimate.

    `seconds`: None if unknown. `least`: it will probably take longer.
    """

    parts: tuple[Part, ...]
    machines: int
    source: str
    least: bool = False

    @property
    def measurements(self) -> int:
        return sum(part.measurements for part in self.parts)

    @property
    def seconds(self) -> float | None:
        seconds = [part.seconds for part in self.parts if part.seconds is not None]
        return sum(seconds) / self.machines if len(seconds) == len(self.parts) else None


@dataclass(frozen=True)
class _Rate:
    """Seconds per frame; None if unknown."""

    seconds: float | None
    source: str
    least: bool = False


def estimate(exploration: Exploration) -> Estimate:
    """How long `exploration`, valid and unsaved, will take."""
    frames = _frames_here()
    rate = _measured(exploration, frames) or _published(exploration) or _unknown(exploration)
    learned = [frames[pack["name"], pack["sha256"]] for pack in exploration.learned_on]
    held_out = [frames[pack["name"], pack["sha256"]] for pack in exploration.held_out_sequences]
    most = exploration.frames
    once = sum(learned if most is None else (min(most, count) for count in learned))
    space = search.search_space(exploration)
    known = len(baseline_configurations.baseline_configurations(exploration.application, space))
    wanted = [("Known configurations", known, once), ("Searched configurations", exploration.budget, once)]
    if ratios.uses_ratio(exploration):
        rounds = ceil(exploration.budget / exploration.batch)
        wanted.append(("The default, once a round", rounds, once))
    again = (exploration.points + known) * exploration.repeats
    wanted.append(("Repeats of the points at the end", again, sum(learned) + sum(held_out)))
    parts = tuple(
        Part(title, count, size, None if rate.seconds is None else count * size * rate.seconds)
        for title, count, size in wanted
        if count
    )
    return Estimate(parts, exploration.reference_device.machines, rate.source, rate.least)


def _frames_here() -> Frames:
    """The frames of the packs on this machine."""
    described = map(sequences.read_description, sequences.packs())
    return {(pack["name"], pack["sha256"]): pack["frames"] for pack in described}


def _measured(exploration: Exploration, frames: Frames) -> _Rate | None:
    """The mean time per frame in the newest measurements of the system on the device; None without any."""
    device = exploration.reference_device
    rows = (
        Evaluation.objects.filter(
            exploration__reference_device=device,
            exploration__application=exploration.application,
            state=Evaluation.State.DONE,
            censored=[],
            started_at__isnull=False,
            finished_at__isnull=False,
        )
        .exclude(phase__in=COPIED)
        .select_related("exploration")
        .order_by("-finished_at")
    )
    rates, searches = [], set()
    for row in rows[:RECENT_MEASUREMENTS]:
        count = _frames_of(row, frames)
        same = (row.device or {}).get("backend", device.backend) == device.backend
        if same and count and row.started_at is not None and row.finished_at is not None:
            rates.append((row.finished_at - row.started_at).total_seconds() / count)
            searches.add(row.exploration_id)
    if not rates:
        return None
    named = ", ".join(map(str, sorted(searches)))
    source = (
        f"{len(rates)} measurements of {exploration.application} on {device} (exploration {named}) took "
        f"{1000 * fmean(rates):.3g} ms a frame on average, with the start of the program"
    )
    return _Rate(fmean(rates), source)


def _frames_of(row: Evaluation, frames: Frames) -> int:
    """The frames that `row` ran; 0 if one of its packs is not on this machine."""
    total = 0
    for pack in sequence_names(row):
        count = frames.get((pack["name"], pack["sha256"]), 0)
        if not count:
            return 0
        total += count if row.frames is None else min(row.frames, count)
    return total


def _published(exploration: Exploration) -> _Rate | None:
    """The default's time per frame in the newest front of a device with that name; None without one."""
    name = exploration.reference_device.name
    for front in selectors.fronts(exploration.application):
        default = front.point(DEFAULT)
        if front.provenance.get("reference_device") != name or default is None:
            continue
        source = (
            f"in front {front.slug} the default computed for {1000 * default.runtime:.3g} ms a frame on "
            f"{front.provenance.get('device', 'a device')}. That device has the name {name} too, but may be "
            "another machine. Starting the program and reading frames are not included"
        )
        return _Rate(default.runtime, source, least=True)
    return None


def _unknown(exploration: Exploration) -> _Rate:
    what = f"{exploration.application} was never measured on {exploration.reference_device}"
    return _Rate(
        None, f"{what}. Start with a small budget, watch how long it takes, and raise the budget then"
    )
