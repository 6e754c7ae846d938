"""Each figure of the paper beside what was measured here, with a verdict."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

import numpy as np

from frontrunner.paper import published
from frontrunner.paper.budget import DEFAULT
from frontrunner.paper.crowd import Crowd
from frontrunner.paper.exploration import ERROR, RUNTIME, Exploration, References
from frontrunner.paper.phases import Phases
from frontrunner.paper.response import Surface

LITTLE_GROWTH = 0.01  # of the hypervolume: a front that grows by less no longer improves
BOTH = "ODROID-XU3", "ASUS T200TA"


class Verdict(Enum):
    """What a figure says of the paper's."""

    REPRODUCED = "reproduced"
    DIFFERENT = "different"
    TOO_FEW = "not answerable with so few samples"
    NOT_HERE = "not answerable here"
    MISSING = "not measured yet"


@dataclass(frozen=True)
class Finding:
    """A figure of the paper, its numbers there and here."""

    figure: str
    paper: str
    here: str
    verdict: Verdict


@dataclass(frozen=True)
class Results:
    """What was measured so far; None for what was not. `references` are those of the explorations before."""

    surface: Surface | None = None
    kfusion: Exploration | None = None
    kfusion_references: References | None = None
    elasticfusion: Exploration | None = None
    elasticfusion_references: References | None = None
    crowd: Crowd | None = None


def findings(results: Results) -> Iterator[Finding]:
    """All figures of the paper, in its order."""
    yield _surface(results.surface)
    if results.kfusion is None:
        yield _missing("exploration of KinectFusion")
    else:
        yield from _exploration(results.kfusion)
        yield _speed(results.kfusion, results.kfusion_references or {})
    if results.elasticfusion is None:
        yield _missing("table of ElasticFusion")
    else:
        yield from _elasticfusion(results.elasticfusion, results.elasticfusion_references or {})
    yield _crowd(results.crowd)
    yield Finding(
        "correlation of devices",
        "high between similar machines, low between others",
        "needs a second device; `frontrunner tune compare` reads the rows of two",
        Verdict.NOT_HERE,
    )


def _missing(figure: str) -> Finding:
    return Finding(figure, "", "", Verdict.MISSING)


def _surface(surface: Surface | None) -> Finding:
    name = "response surface of KinectFusion"
    if surface is None:
        return _missing(name)
    relief = surface.relief
    proven = len(relief.minima) > 1 and relief.bends > 0
    return Finding(
        name,
        "not convex, several minima, not smooth",
        f"{relief.counted} beyond noise, bent downwards at {relief.bends} of {relief.triples} "
        f"places, steps of up to {relief.cliff:.2f}x",
        _verdict(proven, relief.blurred),
    )


def _exploration(exploration: Exploration) -> Iterator[Finding]:
    phases, study = Phases.of(exploration), exploration.study
    few = phases.samples < min(published.RANDOM.values())
    random, active = (int((phases.valid & rows).sum()) for rows in (phases.random, ~phases.random))
    yield Finding(
        "valid configurations by phase",
        "; ".join(
            f"{published.VALID_RANDOM[name]} of {published.RANDOM[name]:,} random, "
            f"{published.VALID_ACTIVE[name]} of {published.ACTIVE[name]:,} active ({name})"
            for name in BOTH
        ),
        f"{random} of {phases.samples:,} random, {active} of {phases.points:,} active",
        _verdict(active > random and phases.points < phases.samples, few and not exploration.ended),
    )
    red, black = phases.front(phases.random), phases.front(~phases.random)
    beaten = sum(bool(((black <= point).all(axis=1) & (black < point).any(axis=1)).any()) for point in red)
    yield Finding(
        "active learning against random sampling",
        "its front lies before that of all random samples",
        f"it beats {beaten} of {len(red)} points of the random front",
        _verdict(2 * beaten > len(red), few and not exploration.ended),
    )
    yield _inflection(phases)
    end = "ended by itself" if exploration.ended else f"stopped by the budget of {study.active} points"
    yield Finding(
        "iterations of active learning",
        f"{published.ITERATIONS}, with 100 to 300 points each; then nothing of the predicted front is left",
        f"{exploration.iterations}, with {phases.points:,} points together; {end}",
        _verdict(exploration.ended, study.iterations is not None),
    )
    if exploration.refits:
        yield Finding(
            "fitting the forests and predicting the whole space",
            f"below {published.REFIT_SECONDS / 60:.0f} minutes an iteration",
            f"at most {max(exploration.refits):.1f} s",
            _verdict(max(exploration.refits) < published.REFIT_SECONDS, False),
        )
    size = len(phases.front())
    least, most = (extreme(published.FRONT.values()) for extreme in (min, max))
    yield Finding(
        "points on the front",
        " and ".join(f"{published.FRONT[name]} ({name})" for name in BOTH),
        str(size),
        _verdict(least <= size <= most, few),
    )


def _inflection(phases: Phases) -> Finding:
    useful = published.RANDOM_USEFUL
    samples = np.cumsum(phases.random)
    rows = [phases.random & (samples <= most) for most in (useful, phases.samples)]
    volumes = [phases.volume(selected) for selected in rows]
    enough = phases.samples >= min(published.RANDOM.values())
    growth = volumes[1] / volumes[0] - 1 if volumes[0] else np.inf
    return Finding(
        "random samples after which the front no longer improves",
        f"{useful:,} of {published.RANDOM['ODROID-XU3']:,}",
        f"the hypervolume grows by {growth:.1%} after {useful:,}"
        if enough
        else f"only {phases.samples:,} samples",
        _verdict(enough and growth < LITTLE_GROWTH, not enough),
    )


def _speed(exploration: Exploration, references: References) -> Finding:
    front = Phases.of(exploration).front()
    default, name = references.get(DEFAULT), "best speed of KinectFusion with a valid trajectory"
    if default is None or not len(front):
        return Finding(name, f"{published.BEST_SPEED:g}x the default", "none is valid", Verdict.DIFFERENT)
    speed = default[RUNTIME] / front[:, 1].min()
    return Finding(
        name,
        f"{published.BEST_SPEED:g}x the default (ODROID-XU3)",
        f"{speed:.1f}x the default of the space",
        _verdict(speed >= published.BEST_SPEED, not exploration.ended),
    )


def _elasticfusion(exploration: Exploration, references: References) -> Iterator[Finding]:
    front = Phases.of(exploration).front()
    default = references.get(DEFAULT)
    theirs, *_, _last = published.ELASTICFUSION
    for row in (published.ELASTICFUSION[1], published.ELASTICFUSION[-1]):
        speed, error = theirs.runtime / row.runtime, row.error / theirs.error
        paper = f"{speed:.2f}x as fast, {error:.2f} of its error"
        if default is None or not len(front):
            yield Finding(
                f"ElasticFusion: {row.label}, over the default", paper, "none is valid", Verdict.DIFFERENT
            )
            continue
        relative = front / [default[ERROR], default[RUNTIME]]
        column = 1 if row.label == "best speed" else 0
        best = relative[np.argmin(relative[:, column])]
        reached = ((relative[:, 1] <= 1 / speed) & (relative[:, 0] <= error)).any()
        yield Finding(
            f"ElasticFusion: {row.label}, over the default",
            paper,
            f"{1 / best[1]:.2f}x as fast, {best[0]:.2f} of its error",
            _verdict(bool(reached), not exploration.ended),
        )


def _crowd(crowd: Crowd | None) -> Finding:
    name = "speedups of the crowd"
    paper = f"{published.LEAST_SPEEDUP:g}x to over {published.MOST_SPEEDUP:g}x on {published.DEVICES} devices"
    if crowd is None:
        return Finding(name, paper, "no server was given (--server URL)", Verdict.NOT_HERE)
    if crowd.simulated:
        return Finding(name, paper, f"the devices of {crowd.server} are simulated", Verdict.NOT_HERE)
    if not crowd.bars:
        return Finding(name, paper, f"{crowd.server} has no device yet", Verdict.TOO_FEW)
    slowest, fastest = (extreme(bar.speedup for bar in crowd.bars) for extreme in (min, max))
    here = f"{slowest:.1f}x to {fastest:.1f}x on {crowd.devices} devices"
    if crowd.devices < published.DEVICES:
        return Finding(name, paper, here, Verdict.TOO_FEW)
    holds = slowest >= published.LEAST_SPEEDUP and fastest > published.MOST_SPEEDUP
    return Finding(name, paper, here, _verdict(holds, False))


def _verdict(holds: bool, few: bool) -> Verdict:
    """What holds is reproduced; what does not is different, unless it rests on too few samples."""
    if holds:
        return Verdict.REPRODUCED
    return Verdict.TOO_FEW if few else Verdict.DIFFERENT
