"""The commands of `python -m pareto`: explore | front | plot."""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

from pareto.errors import EvaluationError, ObjectiveError, ParetoError, ScenarioError
from pareto.evaluation import Evaluate, from_command, from_table
from pareto.explorer import Explorer
from pareto.folder import FRONT, STATE, Folder
from pareto.methods import DEFAULT, METHODS
from pareto.objective import Objective
from pareto.scenario import Scenario, is_scenario
from pareto.space import Space


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return its exit code: 0 done, 2 usage, 130 interrupted with everything saved."""
    options = _parser().parse_args(arguments)
    try:
        return int(options.act(options))
    except ParetoError as error:
        sys.stderr.write(f"pareto: {error}\n")
        return 2
    except KeyboardInterrupt:
        sys.stderr.write("\npareto: interrupted; the same command goes on from here\n")
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m pareto", description=__doc__)
    commands = parser.add_subparsers(required=True)

    explore = commands.add_parser("explore", help="measure configurations until the budget is spent")
    explore.add_argument(
        "--space", type=Path, required=True, help="a space, or a HyperMapper scenario, as JSON"
    )
    explore.add_argument("--objectives", help="names, separated by commas; a scenario brings its own")
    explore.add_argument("--maximise", default="", help="those of the objectives that are maximised")
    explore.add_argument("--limits", default="", help="name=value, separated by commas")
    source = explore.add_mutually_exclusive_group(required=True)
    source.add_argument("--table", type=Path, help="look values up in a CSV file")
    source.add_argument("--command", help="run a program: {config} becomes JSON, {name} a parameter's value")
    explore.add_argument("--timeout", type=float, help="seconds a program may take")
    explore.add_argument(
        "--budget", type=int, required=True, help="measurements, those of earlier runs included"
    )
    explore.add_argument("--batch", type=int, default=20, help="proposals a round")
    explore.add_argument("--method", default=DEFAULT, choices=list(METHODS))
    explore.add_argument("--seed", type=int, default=0)
    explore.add_argument(
        "--out", type=Path, required=True, help="folder; a second run goes on where it ended"
    )
    explore.set_defaults(act=_explore)

    for name, act, text in [
        ("front", _front, "write front.csv of an exploration and print it"),
        ("plot", _plot, "write front.html of an exploration"),
    ]:
        command = commands.add_parser(name, help=text)
        command.add_argument("--space", type=Path, required=True)
        command.add_argument("--out", type=Path, required=True, help="the exploration's folder")
        command.set_defaults(act=act)
    return parser


def _explore(options: argparse.Namespace) -> int:
    space, scenario = _read_space(options.space)
    names = options.objectives.split(",") if options.objectives else []
    if not names and scenario is None:
        raise ScenarioError("--objectives is missing: a,b")
    maximise = set(filter(None, options.maximise.split(",")))
    wanted = [Objective(name, name in maximise) for name in names] or list(
        scenario.objectives if scenario else []
    )
    if unknown := maximise - {objective.name for objective in wanted}:
        raise ObjectiveError(f"--maximise {sorted(unknown)[0]!r} is not an objective")
    if options.batch < 1 or options.budget < 1:
        raise ScenarioError("--budget and --batch must be 1 or more")
    folder = Folder(options.out)
    fresh = Explorer(space, wanted, _limits(options.limits), seed=options.seed, method=options.method)
    explorer = folder.resume(space) or fresh
    _require_same(fresh, explorer)
    evaluate: Evaluate
    if options.table:
        feasible = scenario.feasible if scenario else None
        evaluate = from_table(options.table, space, explorer.objectives, feasible)
    else:
        evaluate = from_command(options.command, explorer.objectives, options.timeout)
    try:
        _measure(explorer, folder, evaluate, options.budget, options.batch)
    finally:
        folder.write_front(explorer)
    _plot(options)
    sys.stdout.write(f"{len(explorer.front())} points on the front: {options.out / FRONT}\n")
    return 0


def _measure(explorer: Explorer, folder: Folder, evaluate: Evaluate, budget: int, batch: int) -> None:
    begun = time.monotonic()
    done = at_begin = sum(map(len, explorer.history.told.values()))
    queue = explorer.pending()
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
        explorer.tell([configuration], [values])
        folder.append(explorer, configuration, values, time.monotonic() - started, error)
        done += 1
        left = (time.monotonic() - begun) / (done - at_begin) * (budget - done)
        _progress(explorer, done, budget, left)
    if sys.stderr.isatty():
        sys.stderr.write("\n")
    folder.asked(explorer)


def _progress(explorer: Explorer, done: int, budget: int, left: float) -> None:
    if not sys.stderr.isatty():
        return
    failed = len(explorer.history.failed())
    front = len(explorer.history.front()[0])
    line = f"{done}/{budget} measured, {failed} failed, {front} on the front, {left:.0f} s left"
    sys.stderr.write(f"\r{line:<78}")
    sys.stderr.flush()


def _front(options: argparse.Namespace) -> int:
    explorer = _finished(options)
    Folder(options.out).write_front(explorer)
    sys.stdout.write((options.out / FRONT).read_text(encoding="utf-8"))
    return 0


def _plot(options: argparse.Namespace) -> int:
    from pareto.plot import save

    save(_finished(options), options.out / "front.html")
    return 0


def _finished(options: argparse.Namespace) -> Explorer:
    space, _ = _read_space(options.space)
    explorer = Folder(options.out).resume(space)
    if explorer is None:
        raise ScenarioError(f"{options.out} holds no exploration: there is no {STATE}")
    return explorer


def _read_space(path: Path) -> tuple[Space, Scenario | None]:
    try:
        description = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return Space.load(path), None  # which says what is wrong with the file
    if is_scenario(description):
        scenario = Scenario.from_dict(description)
        return scenario.space, scenario
    return Space.from_dict(description), None


def _limits(text: str) -> dict[str, float]:
    limits = {}
    for item in filter(None, text.split(",")):
        name, _, value = item.partition("=")
        try:
            limits[name.strip()] = float(value)
        except ValueError:
            raise ObjectiveError(f"--limits {item!r}: write name=number, separated by commas") from None
    return limits


def _require_same(fresh: Explorer, found: Explorer) -> None:
    """Raise ScenarioError when the folder's exploration is not the one asked for."""
    for field in ("objectives", "limits", "seed", "method"):
        asked, had = getattr(fresh, field), getattr(found, field)
        if asked != had:
            raise ScenarioError(
                f"this folder's exploration has {field} {had}, not {asked}: use another --out"
            )
