"""One page over many explorations: a row for each folder."""

from __future__ import annotations

import html
import os
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from pareto.fronts.hypervolume import hypervolume
from pareto.measuring.folder import EVALUATIONS, PAGE, Folder, made_here
from pareto.measuring.progress import summarise_front
from pareto.plot.page import STYLE
from pareto.plot.style import number
from pareto.search.explorer import Explorer
from pareto.search.recommendation import is_noisy

NOTE = (
    "A problem is a space with its objectives and limits. The hypervolumes of one problem end at one "
    "reference: the limits, or the worst of the first ten values of any run. So they can be compared. The "
    "best is bold."
)
HEADS = ("folder", "problem", "measured", "budget", "failed", "front", "hypervolume", "last change")


@dataclass(frozen=True)
class Run:
    """A folder with its exploration, its budget where it is known, and the time of the last measurement."""

    path: Path
    explorer: Explorer
    budget: int | None
    changed: datetime | None

    @classmethod
    def read(cls, path: Path) -> Run | None:
        """Return the run in a folder, which may go on; None before its first proposal. Raises StateError."""
        folder = Folder(path)
        explorer = folder.read(folder.space())
        if explorer is None:
            return None
        table = path / EVALUATIONS
        changed = datetime.fromtimestamp(table.stat().st_mtime).astimezone() if table.exists() else None
        return cls(path, explorer, folder.budget(), changed)

    @property
    def problem(self) -> tuple[object, ...]:
        """What equal problems have in common."""
        limits = tuple(sorted(self.explorer.limits.items()))
        return self.explorer.space.name, self.explorer.space.digest, self.explorer.objectives, limits


def page(runs: Sequence[Run], base: Path) -> str:
    """Return the page as HTML, runs of one problem together, with links relative to the folder `base`."""
    rows = [
        _row(run, volume, best, base)
        for group in _groups(runs)
        for run, (volume, best) in zip(group, _volumes(group), strict=True)
    ]
    head = "".join(f"<th>{name}</th>" for name in HEADS)
    body = "\n".join(rows)
    return (
        '<!doctype html>\n<html lang="en">\n<head><meta charset="utf-8"><title>Explorations</title>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<link rel="icon" href="data:,">\n<style>{STYLE}</style></head>\n'
        f"<body>\n<h1>Explorations</h1>\n<p>{NOTE}</p>\n"
        f'<div class="table" tabindex="0"><table><thead><tr>{head}</tr></thead>\n'
        f"<tbody>{body}</tbody></table></div>\n"
        "</body>\n</html>\n"
    )


def _groups(runs: Sequence[Run]) -> list[list[Run]]:
    groups: dict[tuple[object, ...], list[Run]] = {}
    for run in runs:
        groups.setdefault(run.problem, []).append(run)
    return list(groups.values())


def _volumes(runs: Sequence[Run]) -> list[tuple[float | None, bool]]:
    """Return the hypervolume of each run of one problem, None without a front, and whether it is the best."""
    objectives = runs[0].explorer.objectives
    sign = np.array([objective.sign for objective in objectives])
    fronts = [_expected(run.explorer) for run in runs]
    references = [
        list(summarise_front(run.explorer, run.explorer.estimates().expected).reference.values())
        for run in runs
    ]
    known = np.array([reference for reference in references if reference])
    if not len(known):
        return [(None, False)] * len(runs)
    reference = (known * sign).max(axis=0) * sign
    log = bool(reference.min() > 0 and all((front > 0).all() for front in fronts))
    maximise = [objective.maximise for objective in objectives]
    volumes = [hypervolume(front, reference, maximise, log) if len(front) else None for front in fronts]
    best = max(volume for volume in volumes if volume is not None) if any(map(len, fronts)) else None
    return [(volume, volume == best and len(runs) > 1) for volume in volumes]


def _expected(explorer: Explorer) -> NDArray[np.float64]:
    """Return the (n, objectives) recommended values."""
    names = [objective.name for objective in explorer.objectives]
    rows = [[item.values[name] for name in names] for item in explorer.recommended()]
    return np.array(rows).reshape(-1, len(names))


def _row(run: Run, volume: float | None, best: bool, base: Path) -> str:
    explorer = run.explorer
    picture = run.path / PAGE
    name = html.escape(str(run.path))
    if picture.exists():
        link = quote(Path(os.path.relpath(picture.absolute(), base.absolute())).as_posix())
        name = f'<a href="{link}">{name}</a>'
    objectives = []
    for objective in explorer.objectives:
        limit, bound = explorer.limits.get(objective.name), "at least" if objective.maximise else "at most"
        within = "" if limit is None else f" {bound} {number(limit)}"
        objectives.append(f"{'maximised ' * objective.maximise}{objective.name}{within}")
    shown = "" if volume is None else number(volume)
    cells = [
        name,
        html.escape(f"{explorer.space.name}: {', '.join(objectives)}"),
        f"{made_here(explorer):,}",
        "unknown" if run.budget is None else f"{run.budget:,}",
        f"{len(explorer.history.failed()):,}",
        f"{len(explorer.recommended()):,}{' recommended' * is_noisy(explorer.history)}",
        f"<b>{shown}</b>" if best else shown,
        f"{run.changed:%Y-%m-%d %H:%M}" if run.changed else "",
    ]
    return "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"
