"""All pictures of an exploration on one HTML page that needs no network."""

from __future__ import annotations

import html
from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pareto.fronts.front import knee
from pareto.measuring.folder import made_here
from pareto.measuring.progress import summarise_front
from pareto.plot.arrivals import Arrivals
from pareto.plot.growth import front_over_time, hypervolume_over_evaluations
from pareto.plot.models import grown, importances, parameter_importance, predicted_against_measured
from pareto.plot.parameters import parallel_coordinates, slices
from pareto.plot.scatter import scatter
from pareto.plot.style import FONT, INK, LINE, MUTED, label, number
from pareto.search.explorer import Explorer
from pareto.search.recommendation import Recommended, is_noisy
from pareto.surrogates.prediction import out_of_bag

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

STYLE = f"""
body {{ margin: 0 auto; padding: 24px; max-width: 1400px; font: 15px/1.5 {FONT}; color: {INK}; }}
h1 {{ font-size: 26px; margin: 0 0 4px; }}
h2 {{ font-size: 18px; margin: 0; }}
p {{ color: {MUTED}; margin: 2px 0 8px; max-width: 90ch; }}
dl {{ display: flex; flex-wrap: wrap; gap: 12px 36px; margin: 16px 0 28px; }}
dt {{ color: {MUTED}; font-size: 13px; }}
dd {{ margin: 0; font-size: 22px; }}
.pictures {{ display: grid; grid-template-columns: repeat(2, minmax(0, 1fr)); gap: 32px 28px; }}
.wide {{ grid-column: 1 / -1; }}
.scroll {{ overflow: auto; max-height: 520px; border: 1px solid {LINE}; }}
table {{ border-collapse: collapse; font-size: 13px; width: 100%; font-variant-numeric: tabular-nums; }}
th, td {{ padding: 4px 10px; text-align: right; white-space: nowrap; border-bottom: 1px solid {LINE}; }}
th {{ position: sticky; top: 0; background: white; }}
.table {{ overflow-x: auto; }}
th:first-child, td:first-child {{ text-align: left; font-weight: 600; }}
@media (max-width: 900px) {{
  .pictures {{ grid-template-columns: minmax(0, 1fr); }}
  body {{ padding: 12px; }}
}}
"""
NOTES = {
    "scatter": "Every configuration that was measured without failure. The line is the front "
    "within the limits, the diamond the default configuration. Where repeats of one configuration differ, it "
    "is the recommended front: of expected values, with 95 % intervals.",
    "choice": "The same measurements and the same front, coloured by the parameter that decides which others "
    "are active.",
    "fronts": "The front after a sixteenth, an eighth, a quarter, half and all of the evaluations.",
    "hypervolume": "The volume that the measured points dominate, up to the limits or the worst of "
    "the first ten values; of logarithms where all values are positive. Only its growth is meaningful.",
    "importance": "How much of an objective's variance is lost without knowing the parameter: it is permuted "
    "in rows that the trees of a random forest have not seen. Interactions count for each parameter in them.",
    "slices": "Each point is a measurement, the later the darker.",
    "parallel": "Each line is a measurement; the front is blue. Drag along an axis to select lines.",
    "prediction": "By trees that have not seen the measurement; on the dashed line they would be exact.",
}


def save(explorer: Explorer, path: str | Path, units: Mapping[str, str] | None = None) -> None:
    """Write the page; Plotly's own code, some 5 MB, is in it. `units` by objective are added to its name."""
    Path(path).write_text(page(explorer, units or {}), encoding="utf-8")


def page(explorer: Explorer, units: Mapping[str, str]) -> str:
    """Return the page as HTML."""
    from plotly.offline import get_plotlyjs

    title = html.escape(f"Exploration of {explorer.space.name}")
    return (
        f'<!doctype html>\n<html lang="en">\n<head><meta charset="utf-8"><title>{title}</title>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<link rel="icon" href="data:,">\n<style>{STYLE}</style>\n<script>{get_plotlyjs()}</script></head>\n'
        f"<body>\n<h1>{title}</h1>\n{_summary(explorer)}\n"
        f'<div class="pictures">\n{_pictures(explorer, units)}\n</div>\n</body>\n</html>\n'
    )


def _summary(explorer: Explorer) -> str:
    failed = len(explorer.history.failed())
    front = summarise_front(explorer, explorer.estimates().expected)
    facts = {
        "space": f"{len(explorer.space):,} points",
        "method": f"{explorer.method}, seed {explorer.seed}",
        "measured": f"{made_here(explorer):,}",
        "failed": f"{failed:,}",
        "recommended" if is_noisy(explorer.history) else "on the front": f"{front.size:,}",
        f"hypervolume{' of logarithms' if front.log else ''}": number(front.volume),
    }
    if front.reference:
        facts["up to"] = ", ".join(f"{name} {number(value)}" for name, value in front.reference.items())
    items = "".join(f"<div><dt>{name}</dt><dd>{html.escape(fact)}</dd></div>" for name, fact in facts.items())
    return f"<dl>{items}</dl>"


def _pictures(explorer: Explorer, units: Mapping[str, str]) -> str:
    arrivals = Arrivals.of(explorer)
    if not arrivals.succeeded.any():
        return (
            '<section class="wide"><h2>Nothing to draw</h2><p>No measurement succeeded so far.</p></section>'
        )
    names = arrivals.names
    pairs = [*combinations(range(len(names)), 2)] or [(0, 0)]
    planes = {pair: html.escape(" and ".join(dict.fromkeys(names[axis] for axis in pair))) for pair in pairs}
    parts = [
        _section(f"Exploration: {plane}", NOTES["scatter"], scatter(arrivals, *pair, units), wide=True)
        for pair, plane in planes.items()
    ]
    parts += [
        _section(f"Front over time: {plane}", NOTES["fronts"], front_over_time(arrivals, *pair, units))
        for pair, plane in planes.items()
    ]
    if choice := explorer.space.conditions.choice:
        parts += [
            _section(
                f"By {html.escape(choice.name)}: {plane}",
                NOTES["choice"],
                scatter(arrivals, *pair, units, by=choice),
                wide=True,
            )
            for pair, plane in planes.items()
        ]
    growth = hypervolume_over_evaluations(arrivals)
    parts.append(_section("Hypervolume over evaluations", NOTES["hypervolume"], growth))
    forests = grown(arrivals)
    if forests:
        importance = parameter_importance(importances(arrivals, forests))
        parts.append(_section("Importance of parameters", NOTES["importance"], importance, wide=True))
    parts += [
        _section(f"Slices: {html.escape(name)}", NOTES["slices"], slices(arrivals, column, units), wide=True)
        for column, name in enumerate(names)
    ]
    parallel = parallel_coordinates(arrivals, units)
    parts.append(_section("Parallel coordinates", NOTES["parallel"], parallel, wide=True))
    for name in names:
        if name not in forests:
            continue
        prediction = out_of_bag(forests[name])
        spearman = "none" if prediction.spearman is None else f"{prediction.spearman:.3f}"
        agreement = f" Rank correlation {spearman}, R² {prediction.r2:.3f}"
        agreement += " of the logarithms." if prediction.log else "."
        figure = predicted_against_measured(arrivals, name, prediction, units)
        title = f"Predicted against measured: {html.escape(name)}"
        parts.append(_section(title, NOTES["prediction"] + agreement, figure))
    parts.append(_front_table(explorer, units))
    return "\n".join(parts)


def _section(title: str, note: str, figure: Figure, wide: bool = False) -> str:
    drawing = figure.to_html(
        full_html=False,
        include_plotlyjs=False,
        config={"displaylogo": False, "responsive": True},
    )
    kind = ' class="wide"' if wide else ""
    return f"<section{kind}><h2>{title}</h2><p>{note}</p>\n{drawing}</section>"


def _front_table(explorer: Explorer, units: Mapping[str, str]) -> str:
    """The points of the front with their parameters; the best of each objective and the knee by name."""
    front = explorer.recommended()
    if not front:
        return ""
    noisy = is_noisy(explorer.history)
    names = [objective.name for objective in explorer.objectives]
    table = np.array([[item.values[name] for name in names] for item in front])
    roles: dict[int, list[str]] = {}
    for column, objective in enumerate(explorer.objectives):
        best = int(np.argmin(table[:, column] * objective.sign))
        roles.setdefault(best, []).append(f"best {objective.name}")
    bend = knee(table, [objective.maximise for objective in explorer.objectives])
    roles.setdefault(bend, []).append("knee")
    heads = ["", *(label(name, units) for name in names), *explorer.space.names]
    rows = [
        [
            ", ".join(roles.get(row, [])),
            *(_value(item, name, noisy) for name in names),
            *("" if value is None else str(value) for value in item.configuration.values()),
        ]
        for row, item in enumerate(front)
    ]
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in heads)
    body = "\n".join(
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in cells) + "</tr>" for cells in rows
    )
    title = "The recommended front" if noisy else "The front"
    note = f"{len(front)} configurations that no other beats"
    note += ", by their expected values with 95 % intervals." if noisy else "."
    return (
        f'<section class="wide"><h2>{title}</h2><p>{note}</p>\n'
        f'<div class="scroll" tabindex="0"><table><thead><tr>{head}</tr></thead>\n'
        f"<tbody>{body}</tbody></table></div></section>"
    )


def _value(item: Recommended, name: str, noisy: bool) -> str:
    """Return a value, with its interval where there is one."""
    value = number(item.values[name])
    if not noisy:
        return value
    low, high = map(number, item.intervals[name])
    return f"{value} ({low} to {high})"
