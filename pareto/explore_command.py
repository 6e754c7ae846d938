"""python -m pareto explore: measure configurations until the budget is spent, and lose none on the way."""

from __future__ import annotations

import argparse
import hashlib
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

from pareto.answer import obstacle
from pareto.arguments import (
    add_objectives,
    add_units,
    count,
    read_limits,
    read_objectives,
    read_space,
    read_units,
    seconds,
)
from pareto.errors import AllFailedError, EvaluationError, ScenarioError
from pareto.evaluation import Evaluate, from_table
from pareto.explorer import Explorer
from pareto.folder import FRONT, IMPORTED, Folder, header, made_here
from pareto.interrupts import interruptible
from pareto.measurements import Measurement, read_measurements
from pareto.methods import DEFAULT, METHODS
from pareto.program import from_command
from pareto.progress import Progress
from pareto.scenario import Scenario

BATCH = 20


def add_explore(commands: Any) -> None:
    """Register the command with argparse's `commands`."""
    explore = commands.add_parser("explore", help="measure configurations until the budget is spent")
    explore.add_argument(
        "--space", type=Path, required=True, help="a space, or a HyperMapper scenario, as JSON"
    )
    add_objectives(explore, "names, separated by commas; a scenario brings its own")
    source = explore.add_mutually_exclusive_group(required=True)
    source.add_argument("--table", type=Path, help="look values up in a CSV file")
    source.add_argument("--command", help="run a program: {config} becomes JSON, {name} a parameter's value")
    explore.add_argument("--timeout", type=seconds, help="seconds a program may take")
    explore.add_argument(
        "--budget", type=count, help="measurements, those of earlier runs in this folder included"
    )
    explore.add_argument("--batch", type=count, help=f"proposals a round ({BATCH})")
    explore.add_argument(
        "--random", type=count, metavar="N", help="random measurements before learning begins"
    )
    explore.add_argument(
        "--prior",
        type=Path,
        metavar="CSV",
        help="what another device measured, to start from; it never counts",
    )
    explore.add_argument(
        "--warm-start", type=Path, metavar="CSV", help="measurements of this device by an earlier run"
    )
    explore.add_argument("--levels", type=count, help="values of each real parameter of a scenario")
    add_units(explore)
    explore.add_argument("--no-picture", action="store_true", help="do not draw front.html at the end")
    explore.add_argument("--method", default=DEFAULT, choices=list(METHODS))
    explore.add_argument("--seed", type=int, default=0)
    explore.add_argument(
        "--out", type=Path, required=True, help="folder; a second run goes on where it ended"
    )
    explore.set_defaults(act=explore_folder)


def explore_folder(options: argparse.Namespace) -> int:
    """Explore into the folder; 0 done, 130 interrupted with everything saved."""
    space, scenario = read_space(options.space, options.levels)
    for note in scenario.notes if scenario else ():
        sys.stderr.write(f"pareto: {note}\n")
    objectives = read_objectives(
        options.objectives, options.maximise, scenario.objectives if scenario else ()
    )
    if not objectives:
        raise ScenarioError("--objectives is missing: a,b")
    budget = options.budget or (scenario and scenario.budget)
    if not budget:
        raise ScenarioError("--budget is missing: how many measurements?")
    if options.timeout and not options.command:
        raise ScenarioError("--timeout is for --command: a table answers at once")
    fresh = Explorer(
        space,
        objectives,
        read_limits(options.limits),
        seed=options.seed,
        method=options.method,
        prior=read_measurements(options.prior, space, objectives) if options.prior else (),
        **_method_options(options, scenario),
    )
    header(fresh)  # before anything is measured, since it refuses names that clash
    units = read_units(options.units, objectives)
    known = read_measurements(options.warm_start, space, objectives) if options.warm_start else []
    feasible = scenario.feasible if scenario else None
    evaluate = (
        from_table(options.table, space, fresh.objectives, feasible)
        if options.table
        else from_command(options.command, fresh.objectives, options.timeout, feasible)
    )
    folder = Folder(options.out)
    with folder.locked():
        explorer = folder.resume(space) or fresh
        _require_same(fresh, explorer)
        folder.require_source(*_source(options))
        _tell_known(explorer, folder, known)
        batch = options.batch or BATCH
        reasons = _measure(explorer, folder, evaluate, budget, batch)
        folder.write_front(explorer)
        if not options.no_picture:
            _draw(explorer, options.out / "front.html", units)
        _report(explorer, options.out, budget, reasons)
    return 0


def _tell_known(explorer: Explorer, folder: Folder, known: list[Measurement]) -> None:
    """Tell what an earlier run measured, each row once, however often the command is started again."""
    history = explorer.history
    folder.asked(explorer)  # a state must stand before the rows that it does not know
    seen: Counter[int] = Counter()
    told = {index: len(values) for index, values in history.told.items()}
    for configuration, values in known:
        index = explorer.space.encode(configuration)
        seen[index] += 1
        of_this_run = index in history.pending or history.phases.get(index, IMPORTED) != IMPORTED
        if of_this_run or seen[index] <= told.get(index, 0):
            continue
        explorer.tell([configuration], [values], phase=IMPORTED)
        folder.append(explorer, configuration, values, error="" if values else "failed in the earlier run")


def _measure(explorer: Explorer, folder: Folder, evaluate: Evaluate, budget: int, batch: int) -> Counter[str]:
    """Measure until the budget is spent or the method has nothing to ask; return the reasons of failures."""
    reasons: Counter[str] = Counter()
    progress = Progress(explorer, budget, sys.stderr)
    queue, done = explorer.pending(), made_here(explorer)
    with interruptible() as interrupts:
        try:
            while done < budget:
                if not queue:
                    queue = explorer.ask(min(batch, budget - done))
                    folder.asked(explorer)
                if not queue:
                    break
                configuration = queue.pop(0)
                started, error = time.monotonic(), ""
                try:
                    values: dict[str, float] | None = evaluate(configuration)
                except EvaluationError as failure:
                    values, error = None, str(failure)
                    reasons[error] += 1
                with interrupts.held():  # what was measured is written down first
                    explorer.tell([configuration], [values])
                    folder.append(explorer, configuration, values, time.monotonic() - started, error)
                done += 1
                progress.tell(done)
            folder.asked(explorer)
        except KeyboardInterrupt:
            progress.end()
            folder.write_front(explorer)
            raise KeyboardInterrupt(
                f"interrupted after {made_here(explorer)} of {budget} measurements, all of them saved in "
                f"{folder.path}; the same command goes on from there"
            ) from None
    progress.end()
    return reasons


def _draw(explorer: Explorer, path: Path, units: dict[str, str]) -> None:
    from pareto.plot import save  # which loads Plotly

    save(explorer, path, units)


def _report(explorer: Explorer, out: Path, budget: int, reasons: Counter[str]) -> None:
    """Say what was found and what was not."""
    done, front = made_here(explorer), len(explorer.front())
    if done < budget:
        sys.stderr.write(
            f"pareto: stopped after {done} of {budget}: {explorer.method} has nothing more to ask\n"
        )
    if missing := obstacle(explorer.history):
        sys.stderr.write(f"pareto: {missing}\n")
    if isinstance(missing, AllFailedError) and reasons:
        reason, times = reasons.most_common(1)[0]
        sys.stderr.write(f"pareto: {times} times the reason was: {reason}\n")
    sys.stdout.write(f"{front} points on the front: {out / FRONT}\n")


def _source(options: argparse.Namespace) -> tuple[str, str]:
    """Return what measures: the command, or the digest of the table, which may be moved."""
    if options.command:
        return "command", options.command
    with options.table.open("rb") as file:
        return "sha256 of the table", hashlib.file_digest(file, "sha256").hexdigest()


def _method_options(options: argparse.Namespace, scenario: Scenario | None) -> dict[str, Any]:
    """Return `initial`: what --random says, or the scenario, but that only with the scenario's own budget."""
    if options.random:
        return {"initial": options.random}  # a method that has no such option says so
    known = "initial" in METHODS[options.method].defaults()
    initial = scenario.initial if scenario and not options.budget and known else None
    return {"initial": initial} if initial else {}


def _require_same(fresh: Explorer, found: Explorer) -> None:
    """Raise ScenarioError when the folder's exploration is not the one asked for."""
    asked, had = fresh.state(), found.state()
    for field in ("objectives", "limits", "seed", "method", "options"):
        if asked[field] != had[field]:
            raise ScenarioError(
                f"this folder's exploration has {field} {had[field]}, not {asked[field]}: use another --out"
            )
    if "prior" in asked and asked["prior"] != had.get("prior"):
        raise ScenarioError("this folder's exploration began with another --prior: use another --out")
