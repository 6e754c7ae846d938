"""The page: each figure and table of the paper beside what was measured here."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from frontrunner.paper import published
from frontrunner.paper.budget import DEFAULT, Budget
from frontrunner.paper.crowd import Crowd
from frontrunner.paper.exploration import ERROR, RUNTIME, Exploration, References
from frontrunner.paper.figures import UNITS, bars, fronts
from frontrunner.paper.findings import Results, Verdict, findings
from frontrunner.paper.page import Section, Table
from frontrunner.paper.phases import Phases
from frontrunner.paper.response import Surface
from pareto.fronts.front import knee
from pareto.plot.arrivals import Arrivals
from pareto.plot.growth import hypervolume_over_evaluations
from pareto.plot.scatter import scatter
from slam.reports import surface as surfaces
from wire.protocol import VALID_BELOW

TITLE = "The paper, measured again"


def sections(results: Results, budget: Budget, name: str, machine: str) -> Iterator[Section]:
    """The sections of the page; of what was not measured yet the first one says so."""
    found = list(findings(results))
    counts = [(verdict, sum(item.verdict is verdict for item in found)) for verdict in Verdict]
    summary = ", ".join(f"{count} {verdict.value}" for verdict, count in counts if count)
    yield Section(
        "What was reproduced",
        (
            "Nardi et al. 2017, Algorithmic Performance-Accuracy Trade-off in 3D Vision Applications Using "
            f"HyperMapper, beside what `frontrunner paper --budget {name}` measured on {machine}.",
            f"Of {len(found)} statements: {summary}. A statement that holds here is reproduced. One that "
            "does not is different, unless so few samples could not have shown it.",
            Table(
                ("", "the paper", "here", "verdict"),
                [(item.figure, item.paper, item.here, item.verdict.value) for item in found],
                prose=True,
            ),
            f"Searches are Algorithm 1 as printed. Every run is whole: {_frames(budget.kfusion.frames)} of a "
            "synthetic living room with a Kinect's noise, where the paper has 400 of ICL-NUIM's. The error "
            f"is the largest distance of a frame from its true position; below {100 * VALID_BELOW:g} cm a "
            "configuration is valid. Times are computation a frame, from the eleventh frame on.",
        ),
    )
    if results.surface:
        yield _surface(results.surface)
    for exploration, references in (
        (results.kfusion, results.kfusion_references),
        (results.elasticfusion, results.elasticfusion_references),
    ):
        if exploration:
            yield _search(exploration)
            yield _predicted(exploration)
            yield _front(exploration, references or {})
    if results.elasticfusion:
        yield _published_table()
    if results.crowd:
        yield _crowd(results.crowd)
    yield Section(
        "To repeat it",
        (
            f"`frontrunner paper --budget {name} --out DIR` measures what DIR lacks: it continues from the "
            "files `evaluations.csv` in its folders alone, also on another machine. Rows are kept as they "
            "are, so continue on a machine of the same kind, or times are not comparable.",
        ),
    )


def _frames(frames: int | None) -> str:
    return "all 100 frames" if frames is None else f"{frames} frames"


def _surface(surface: Surface) -> Section:
    study = surface.study
    drawn = surfaces.figures(study.grid, surface.measured, f"{study.rounds} rounds")
    return Section(
        "Response surface of KinectFusion",
        (
            f"The time of a frame over {study.grid.x} and {study.grid.y}, all else at the default of the "
            f"space, over {_frames(study.frames)}. Each round measures every point once, in another order.",
            surface.relief.describe(),
            "A minimum counts where every way out climbs by more than four standard errors of a difference. "
            "A cell bends downwards where it lies above the line between its neighbours by as much.",
            "Milliseconds a frame, means over the rounds:",
            _grid(surface),
            *drawn,
        ),
    )


def _grid(surface: Surface) -> Table:
    """The mean times: a row for each y, a column for each x."""
    grid, times = surface.study.grid, 1e3 * surface.measured["runtime"].mean(axis=0)
    return Table(
        (f"{grid.y}, {grid.x}", *(f"{value:g}" for value in grid.x_values)),
        [(f"{y:g}", *(f"{time:.1f}" for time in row)) for y, row in zip(grid.y_values, times, strict=True)],
    )


def _search(exploration: Exploration) -> Section:
    study, phases = exploration.study, Phases.of(exploration)
    history = exploration.explorer.history
    both = {tuple(point) for point in phases.front().tolist()}
    rows = []
    for title, chosen, measured in (
        ("random samples", phases.random, phases.samples),
        ("active learning", ~phases.random, phases.points),
        ("both", phases.random | ~phases.random, phases.samples + phases.points),
    ):
        front = [tuple(point) for point in phases.front(chosen).tolist()]
        kept = sum(point in both for point in front)
        failed = measured - int(chosen.sum())
        rows.append(
            tuple(map(str, (title, measured, failed, (chosen & phases.valid).sum(), len(front), kept)))
        )
    arrivals = Arrivals.of(exploration.explorer)
    return Section(
        f"Exploration of {study.title}",
        (
            f"{len(history.space):,} configurations, {study.random:,} random samples, then "
            f"{exploration.iterations} iterations of active learning. "
            + (
                "Algorithm 1 ended by itself."
                if exploration.ended
                else "It did not end by itself: the budget was spent."
            ),
            Table(("phase", "measured", "failed", "valid", "on its own front", "on the front of both"), rows),
            scatter(arrivals, units=UNITS),
            hypervolume_over_evaluations(arrivals),
        ),
    )


def _predicted(exploration: Exploration) -> Section:
    explorer = exploration.explorer
    encode = explorer.space.encode
    predicted = [encode(configuration) for configuration, _ in exploration.predicted]
    indices, values = explorer.history.measured()
    measured = dict(zip(indices.tolist(), values[:, 0].tolist(), strict=True))
    known = [index for index in predicted if index in measured]
    front = {encode(configuration) for configuration, _ in explorer.front()}
    rows = [
        ("points of the predicted front P", len(predicted)),
        ("of these measured", len(known)),
        ("of these valid", sum(measured[index] < VALID_BELOW for index in known)),
        ("points of the measured front", len(front)),
        ("of these on P", len(front & set(predicted))),
    ]
    return Section(
        f"Predicted and measured front of {exploration.study.title}",
        (
            "Algorithm 1 returns P, the front of the whole space as its forests predict it. What was "
            "measured is another front: a forest's mean is not a measurement, and P does not know the limit.",
            Table(("", "points"), [(label, str(count)) for label, count in rows]),
            fronts(exploration),
        ),
    )


def _front(exploration: Exploration, references: References) -> Section:
    """The table of the front: the references, then its points from the fastest to the most accurate."""
    study, explorer = exploration.study, exploration.explorer
    front = sorted(explorer.front(), key=lambda point: point[1][RUNTIME])
    labels = [""] * len(front)
    if front:
        bend = knee([[values[ERROR], values[RUNTIME]] for _, values in front])
        for row, label in ((bend, "knee"), (len(front) - 1, "best accuracy"), (0, "best speed")):
            labels[row] = ", ".join(filter(None, (label, labels[row])))
    default = references.get(DEFAULT)
    known = [
        (label, configuration, references[label])
        for label, configuration in study.configurations().items()
        if label in references
    ]
    points = [(label, *point) for label, point in zip(labels, front, strict=True)]
    return Section(
        f"Front of {study.title}",
        (
            "The default is that of the space: its time, the median of three runs, is the denominator of "
            "every speed. Points of the front were measured once.",
            Table(
                ("", "error, cm", "ms a frame", "speed", *explorer.space.names),
                [
                    _row(label, configuration, values, default)
                    for label, configuration, values in known + points
                ],
            ),
        ),
    )


def _row(
    label: str,
    configuration: Mapping[str, Any],
    values: Mapping[str, float],
    default: Mapping[str, float] | None,
) -> tuple[str, ...]:
    speed = f"{default[RUNTIME] / values[RUNTIME]:.2f}x" if default else ""
    cells = (f"{value:g}" if isinstance(value, float) else str(value) for value in configuration.values())
    return (label, f"{100 * values[ERROR]:.2f}", f"{1e3 * values[RUNTIME]:.2f}", speed, *cells)


def _published_table() -> Section:
    default = published.ELASTICFUSION[0]
    names = list(default.configuration)
    return Section(
        "The paper's table of ElasticFusion",
        (
            "On a GTX 780 Ti and ICL-NUIM's living room 2; other flags are at their defaults.",
            Table(
                ("", "error, cm", "seconds", "speed", *names),
                [
                    (
                        row.label,
                        f"{100 * row.error:.2f}",
                        f"{row.runtime:g}",
                        f"{default.runtime / row.runtime:.2f}x",
                        *(str(row.configuration[name]) for name in names),
                    )
                    for row in published.ELASTICFUSION
                ],
            ),
        ),
    )


def _crowd(crowd: Crowd) -> Section:
    note = " Its devices are simulated: nothing here was measured." if crowd.simulated else ""
    return Section(
        "Speedups of the crowd",
        (
            f"{len(crowd.bars)} figures of {crowd.devices} devices on {crowd.server}, of the front "
            f"{crowd.front}.{note} The denominator is the crowd's default (STANDARD) on the same device.",
            *([_bars(crowd), bars(crowd)] if crowd.bars else []),
        ),
    )


def _bars(crowd: Crowd) -> Table:
    return Table(
        ("device", "speedup", "95 % interval", "state"),
        [
            (
                bar.label,
                f"{bar.speedup:.1f}x",
                "" if bar.low is None or bar.high is None else f"{bar.low:.1f} to {bar.high:.1f}",
                "confirmed" if bar.confirmed else "unconfirmed",
            )
            for bar in crowd.bars
        ],
    )
