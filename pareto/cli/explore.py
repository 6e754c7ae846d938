"""python -m pareto explore: measure configurations until the budget is spent; no measurement is lost."""

from __future__ import annotations

import argparse
import hashlib
import math
import sys
from collections import Counter
from collections.abc import Collection
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from groundwork import terminal
from pareto.cli.arguments import (
    WORKERS_HOST,
    add_feasible,
    add_objectives,
    add_units,
    address,
    after_hours,
    count,
    port,
    read_feasible,
    read_limits,
    read_objectives,
    read_resources,
    read_space,
    read_units,
    seconds,
    time_of_day,
    whole,
)
from pareto.cli.live_page import LivePage, served
from pareto.errors import (
    AllFailedError,
    ConstantObjectiveError,
    DamagedStateError,
    NothingMeasuredError,
    ScenarioError,
)
from pareto.measuring.folder import EVALUATIONS, FRONT, IMPORTED, Folder, header, made_here
from pareto.measuring.hosts import Host, Hosting
from pareto.measuring.loop import MeasurementLoop, Plan
from pareto.measuring.measurements import Feasible, Measurement, read_measurements
from pareto.measuring.placeholders import CONFIG
from pareto.measuring.pool import Measure, Pool
from pareto.measuring.program import GRACE, Program
from pareto.measuring.progress import summarise_front
from pareto.measuring.table import from_table
from pareto.search.answer import constant_objectives, obstacle, parameters_without_effect
from pareto.search.explorer import Explorer
from pareto.search.methods import DEFAULT, METHODS
from pareto.search.noise import describe_noise
from pareto.search.recommendation import is_noisy
from pareto.spaces.parameter import Value
from pareto.spaces.scenario import Scenario
from pareto.spaces.space import Space

BATCH = 20
GIVE_UP = 10  # equal failures at the start: a broken program, not a difficult space
PORT, WORKERS_PORT = 8765, 8766
FAILED = 1  # the exit code where nothing succeeded


def add_arguments(explore: argparse.ArgumentParser) -> None:
    """Add the command's options to its parser."""
    explore.add_argument(
        "--space", type=Path, required=True, help="JSON: a space, a HyperMapper scenario or a ConfigSpace"
    )
    add_objectives(explore, "names, separated by commas; a scenario brings its own")
    source = explore.add_mutually_exclusive_group(required=True)
    source.add_argument("--table", type=Path, help="look values up in a CSV file")
    source.add_argument(
        "--command", help="run a program: {config} is replaced by JSON, {name} by a parameter's value"
    )
    explore.add_argument("--timeout", type=seconds, help="seconds a program may take")
    explore.add_argument(
        "--grace",
        type=seconds,
        default=GRACE,
        metavar="S",
        help=f"seconds between SIGTERM and SIGKILL for a program that must end ({GRACE:g})",
    )
    explore.add_argument("--jobs", type=count, metavar="N", help="programs that run at the same time (1)")
    explore.add_argument(
        "--serve-workers",
        type=address,
        nargs="?",
        const=(WORKERS_HOST, WORKERS_PORT),
        metavar="[HOST:]PORT",
        help=f"let `frontrunner worker` measure, also on other hosts ({WORKERS_HOST}:{WORKERS_PORT})",
    )
    explore.add_argument(
        "--resource",
        action="append",
        default=[],
        metavar="NAME=A,B,..",
        help="each running program gets one item, as the variable NAME and the placeholder {NAME}",
    )
    explore.add_argument(
        "--repeats", type=count, default=1, metavar="N", help="measurements of each configuration (1)"
    )
    explore.add_argument(
        "--give-up",
        type=whole,
        metavar="N",
        help=f"end after N equal failures at the start ({GIVE_UP}); 0 for never",
    )
    explore.add_argument(
        "--budget", type=count, help="measurements, including those of earlier runs in this folder"
    )
    end = explore.add_mutually_exclusive_group()
    end.add_argument(
        "--hours",
        type=after_hours,
        metavar="H",
        help="start no measurement after H hours; running ones finish",
    )
    end.add_argument(
        "--until", type=time_of_day, metavar="HH:MM", help="start no measurement after this local time"
    )
    explore.add_argument("--batch", type=count, help=f"proposals a round ({BATCH})")
    explore.add_argument(
        "--random", type=count, metavar="N", help="random measurements before learning begins"
    )
    explore.add_argument(
        "--prior",
        type=Path,
        metavar="CSV",
        help="measurements of another device to start from; they do not count",
    )
    explore.add_argument(
        "--warm-start", type=Path, metavar="CSV", help="measurements of this device by an earlier run"
    )
    add_feasible(explore)
    explore.add_argument("--levels", type=count, help="values of each real parameter of a scenario (any)")
    add_units(explore)
    explore.add_argument("--no-picture", action="store_true", help="do not draw front.html")
    explore.add_argument(
        "--serve",
        type=port,
        nargs="?",
        const=PORT,
        metavar="PORT",
        help=f"show front.html to a browser on this machine while the search runs ({PORT})",
    )
    explore.add_argument("--method", default=DEFAULT, choices=list(METHODS))
    explore.add_argument("--seed", type=int, default=0)
    explore.add_argument(
        "--out", type=Path, required=True, help="folder; a second run goes on where it ended"
    )
    explore.set_defaults(act=explore_folder)


def explore_folder(options: argparse.Namespace) -> int:
    """Explore into the folder; 0 done, 1 nothing succeeded, 130 interrupted with everything saved."""
    space, scenario = read_space(options.space, options.levels)
    for note in scenario.notes if scenario else ():
        terminal.note(note)
    feasible = read_feasible(options.feasible, scenario)
    fresh = _new_explorer(options, space, scenario, feasible)
    plan = _plan(options, scenario)
    units = read_units(options.units, fresh.objectives)
    earlier = []
    if options.warm_start:
        earlier = read_measurements(options.warm_start, space, fresh.objectives, feasible)
    slots = _slots(options, [CONFIG, *space.names])
    program = None
    if options.command:
        program = Program(
            options.command,
            space.names,
            fresh.objectives,
            options.timeout,
            feasible,
            resources=slots[0],
            grace=options.grace,
        )
    folder = Folder(options.out)
    with ExitStack() as stack:
        stack.enter_context(folder.locked())
        explorer = _resume(folder, fresh)
        _require_same(fresh, explorer)
        explorer.budget = plan.budget
        folder.require_source(*_source(options))
        folder.record_budget(plan.budget)
        _report_choices(space, program)
        _tell_known(explorer, folder, earlier)
        page = None if options.no_picture else LivePage(explorer, options.out, units)
        if page and options.serve is not None:
            address = stack.enter_context(served(options.out, options.serve))
            page.draw()
            terminal.note(f"the progress is shown at {address}")
        measure: Measure = program or _lookup(options.table, fresh, feasible)
        end = program.end if program else lambda: None
        if options.serve_workers:
            serve: Host = options.host
            hosted = stack.enter_context(serve(_hosting(options, explorer, feasible, len(slots))))
            measure, end = hosted, hosted.end
        loop = MeasurementLoop(
            explorer,
            folder,
            Pool(measure, slots),
            plan,
            end=end,
            refresh=page.refresh if page else lambda: None,
        )
        loop.run()
        folder.write_front(explorer)
        if page:
            page.draw()
        return _report(explorer, options.out, loop)


def _new_explorer(
    options: argparse.Namespace, space: Space, scenario: Scenario | None, feasible: Feasible | None
) -> Explorer:
    """Return a new explorer. Raises ScenarioError where there are no objectives."""
    objectives = read_objectives(
        options.objectives, options.maximise, scenario.objectives if scenario else ()
    )
    if not objectives:
        raise ScenarioError("--objectives is missing: a,b")
    explorer = Explorer(
        space,
        objectives,
        read_limits(options.limits),
        seed=options.seed,
        method=options.method,
        prior=read_measurements(options.prior, space, objectives, feasible) if options.prior else (),
        **_method_options(options, scenario),
    )
    header(explorer)  # before anything is measured: it rejects names that clash
    return explorer


def _plan(options: argparse.Namespace, scenario: Scenario | None) -> Plan:
    """Return the plan of the measurements. Raises ScenarioError for options that contradict each other."""
    budget = options.budget or (scenario and scenario.budget)
    if not budget:
        raise ScenarioError("--budget is missing: how many measurements?")
    if options.serve_workers and options.host is None:
        raise ScenarioError("--serve-workers is for `frontrunner tune`, which has the server")
    if options.serve_workers and options.resource:
        raise ScenarioError(
            "--resource is of one machine: with --serve-workers, write it into each --command"
        )
    for name in ("timeout", "jobs", "resource", "give_up", "serve_workers"):
        if getattr(options, name) and not options.command:
            raise ScenarioError(f"--{name.replace('_', '-')} is for --command: a table answers at once")
    if options.table and options.repeats > 1:
        raise ScenarioError("--repeats is for --command: a table answers the same each time")
    if options.no_picture and options.serve is not None:
        raise ScenarioError("--serve shows front.html, which --no-picture leaves out: give one of them")
    give_up = GIVE_UP if options.give_up is None and options.command else options.give_up or 0
    deadline = options.hours or options.until or math.inf
    return Plan(budget, options.batch or BATCH, options.repeats, give_up, deadline)


def _hosting(
    options: argparse.Namespace, explorer: Explorer, feasible: Feasible | None, jobs: int
) -> Hosting:
    host, number = options.serve_workers
    limits = options.timeout, options.grace
    return Hosting(host, number, options.out, options.command, explorer, feasible, *limits, jobs)


def _lookup(table: Path, explorer: Explorer, feasible: Feasible | None) -> Measure:
    evaluate = from_table(table, explorer.space, explorer.objectives, feasible)
    return lambda configuration, _resources, _conditions: evaluate(configuration)


def _tell_known(explorer: Explorer, folder: Folder, earlier: list[Measurement]) -> None:
    """Tell the explorer the measurements of an earlier run, each row once per folder."""
    history = explorer.history
    folder.asked(explorer)  # the state must be written before rows that it does not contain
    seen: Counter[int] = Counter()
    waiting = history.waiting()
    recorded = {index: len(values) for index, values in history.results.items()}
    for configuration, values in earlier:
        index = explorer.space.encode(configuration)
        seen[index] += 1
        of_this_run = index in waiting or history.phases.get(index, IMPORTED) != IMPORTED
        if of_this_run or seen[index] <= recorded.get(index, 0):
            continue
        explorer.tell([configuration], [values], phase=IMPORTED)
        folder.append(explorer, configuration, values, error="" if values else "failed in the earlier run")


def _resume(folder: Folder, fresh: Explorer) -> Explorer:
    """Return the folder's explorer, rebuilt from its measurements where its state is lost, or `fresh`."""
    try:
        return folder.resume(fresh.space) or fresh
    except DamagedStateError as error:
        reason = str(error).rsplit(": ", 1)[0]
        explorer = folder.rebuild(fresh, reason)
        rows = explorer.history.measurements
        terminal.warn(
            f"{reason}: it was rebuilt from the {rows} rows of {EVALUATIONS}; the search goes "
            "on with these measurements and the options given now"
        )
        return explorer


def _report_choices(space: Space, program: Program | None) -> None:
    """Report the defaults that were chosen."""
    if chosen := [f"{name} = {_default(space, name)!r}" for name in space.defaults_chosen]:
        terminal.note(f"no default given, so chosen: {', '.join(chosen)}")
    used = program.template.used if program else {CONFIG}
    unused = [item.name for item in space.parameters if len(item.values) > 1 and item.name not in used]
    if not used & {CONFIG, *space.names}:
        terminal.warn(
            "--command has no placeholder such as {config}: the program cannot know what it measures"
        )
    elif CONFIG not in used and unused:
        terminal.warn(
            f"--command has no placeholder of {', '.join(unused)}: the program cannot know the value"
        )


def _default(space: Space, name: str) -> Value:
    return next(item.default for item in space.parameters if item.name == name)


def _report(explorer: Explorer, out: Path, loop: MeasurementLoop) -> int:
    """Print the result; return the exit code."""
    done, budget = made_here(explorer), loop.plan.budget
    missing = obstacle(explorer.history)
    if loop.stopped:
        terminal.fail(
            f"stopped: the first {loop.plan.give_up} measurements failed in the same way: {loop.stopped}"
        )
        terminal.note(
            "correct that and start with a new --out, or allow more failures with --give-up N (0: any number)"
        )
    elif loop.late and done < budget:
        terminal.note(
            f"the time is over: stopped after {done} of {budget}; the same command goes on from here"
        )
    elif done < budget:
        terminal.note(f"stopped after {done} of {budget}: {explorer.method} has nothing more to propose")
    if missing and not isinstance(missing, NothingMeasuredError):
        terminal.note(str(missing))
    if isinstance(missing, AllFailedError) and loop.reasons:
        reason, times = loop.reasons.most_common(1)[0]
        terminal.note(f"{times} times the reason was: {reason}")
    if not isinstance(missing, ConstantObjectiveError):
        for name, value in constant_objectives(explorer.history).items():
            terminal.warn(f"{name} was {value:g} in every configuration")
        for name, runs in parameters_without_effect(explorer.history).items():
            terminal.warn(
                f"{name} changed nothing: {runs} runs that differ in it alone have equal objectives; check "
                "that the program uses it"
            )
    front = summarise_front(explorer, explorer.estimates().expected)
    kind = "recommended" if is_noisy(explorer.history) else "on the front"
    sys.stdout.write(
        f"{front.size} point{'' if front.size == 1 else 's'} {kind}: {out / FRONT}\n"
        f"{describe_noise(explorer.history)}\n{front.describe()}\n"
    )
    return FAILED if loop.stopped or isinstance(missing, AllFailedError) else 0


def _slots(options: argparse.Namespace, taken: Collection[str]) -> list[dict[str, str]]:
    """Return the resources of each program that runs in parallel: an item of each --resource.

    Raises ScenarioError where there are too few items, or a resource has one of the names that are `taken`.
    """
    resources = read_resources(options.resource)
    fewest = min(map(len, resources.values()), default=None)
    jobs = options.jobs or fewest or (options.batch or BATCH if options.serve_workers else 1)
    for name, items in resources.items():
        if name in taken:
            raise ScenarioError(f"--resource {name} has the name of a parameter: give it another name")
        if jobs > len(items):
            raise ScenarioError(
                f"--jobs {jobs} needs {jobs} items of --resource {name}, which has {len(items)}"
            )
    return [{name: items[slot] for name, items in resources.items()} for slot in range(jobs)]


def _source(options: argparse.Namespace) -> tuple[str, str]:
    """Return the source of measurements: the command, or the digest of the table, which may be moved."""
    if options.command:
        return "command", options.command
    with options.table.open("rb") as file:
        return "sha256 of the table", hashlib.file_digest(file, "sha256").hexdigest()


def _method_options(options: argparse.Namespace, scenario: Scenario | None) -> dict[str, Any]:
    """Return `initial`: from --random, or from the scenario if its budget is used, too."""
    if options.random:
        return {"initial": options.random}  # a method without this option rejects it
    takes_initial = "initial" in METHODS[options.method].defaults()
    initial = scenario.initial if scenario and not options.budget and takes_initial else None
    return {"initial": initial} if initial else {}


def _require_same(fresh: Explorer, stored: Explorer) -> None:
    """Raise ScenarioError when the folder holds a different exploration."""
    asked, had = fresh.state(), stored.state()
    for field in ("objectives", "limits", "seed", "method", "options"):
        if asked[field] != had[field]:
            raise ScenarioError(
                f"this folder's exploration has {field} {had[field]}, not {asked[field]}: use another --out"
            )
    if "prior" in asked and asked["prior"] != had.get("prior"):
        raise ScenarioError("this folder's exploration began with another --prior: use another --out")
