"""Shared by the commands of `python -m pareto`: reading arguments and reporting errors in them."""

from __future__ import annotations

import argparse
import math
import re
import time
from collections.abc import Iterable
from datetime import datetime, timedelta
from pathlib import Path

from pareto.errors import ObjectiveError, ScenarioError, SpaceError
from pareto.fronts.objective import Objective
from pareto.measuring.measurements import Feasible
from pareto.spaces import kernel_tuner
from pareto.spaces.configspace import is_configspace, read_configspace
from pareto.spaces.scenario import Scenario, is_scenario
from pareto.spaces.space import Space

WORKERS_HOST = "127.0.0.1"


def add_objectives(command: argparse.ArgumentParser, objectives: str) -> None:
    """Add --objectives (with its help text), --maximise and --limits."""
    command.add_argument("--objectives", help=objectives)
    command.add_argument("--maximise", default="", help="those of the objectives that are maximised")
    command.add_argument(
        "--limits", "--limit", action="append", default=[], metavar="NAME=VALUE", help="separated by commas"
    )


def read_objectives(names: str | None, maximise: str, otherwise: Iterable[Objective]) -> list[Objective]:
    """Return the objectives that the arguments name, or `otherwise`.

    Raises ObjectiveError for an unknown maximised one.
    """
    upwards = split(maximise)
    wanted = [Objective(name, name in upwards) for name in split(names)] or list(otherwise)
    for name in upwards:
        if name not in {objective.name for objective in wanted}:
            raise ObjectiveError(f"--maximise {name!r} is not an objective")
    return wanted


def add_feasible(command: argparse.ArgumentParser) -> None:
    """Add --feasible."""
    command.add_argument(
        "--feasible",
        metavar="COLUMN=TEXT",
        help="only measurements with TEXT in COLUMN are feasible; a scenario brings its own",
    )


def read_feasible(text: str | None, scenario: Scenario | None) -> Feasible | None:
    """Return column and text of --feasible, or else of the scenario. Raises ScenarioError."""
    if text is None:
        return scenario.feasible if scenario else None
    column, _, value = (part.strip() for part in text.partition("="))
    if not column or not value:
        raise ScenarioError(f"--feasible {text!r}: write COLUMN=TEXT, as in valid=true")
    return column, value


def required_objectives(options: argparse.Namespace, scenario: Scenario | None) -> list[Objective]:
    """Return the objectives of --objectives or else of the scenario. Raises ObjectiveError without any."""
    otherwise = scenario.objectives if scenario else ()
    objectives = read_objectives(options.objectives, options.maximise, otherwise)
    if not objectives:
        raise ObjectiveError("--objectives is missing: a,b")
    return objectives


def read_limits(texts: Iterable[str]) -> dict[str, float]:
    """Return the limits of NAME=VALUE texts, several in one separated by commas."""
    limits = {}
    for item in split(",".join(texts)):
        name, _, value = item.partition("=")
        try:
            limits[name.strip()] = float(value)
        except ValueError:
            raise ObjectiveError(f"--limits {item!r}: write name=number, separated by commas") from None
    return limits


def add_units(command: argparse.ArgumentParser) -> None:
    """Add --units, for the pictures."""
    command.add_argument(
        "--units",
        default="",
        metavar="NAME=UNIT",
        help="of objectives, for the pictures; separated by commas",
    )


def read_units(text: str, objectives: Iterable[Objective]) -> dict[str, str]:
    """Return the units of a NAME=UNIT text. Raises ObjectiveError for an unknown objective."""
    units = {}
    for item in split(text):
        name, _, unit = item.partition("=")
        if name not in {objective.name for objective in objectives} or not unit:
            raise ObjectiveError(f"--units {item!r}: write objective=unit, separated by commas")
        units[name] = unit
    return units


def read_space(path: Path, levels: int | None = None) -> tuple[Space, Scenario | None]:
    """Return the space of a JSON file, and the scenario where it is HyperMapper's or another program's.

    `levels` are the values of each real parameter of such a file; without them it may take any value.
    """
    try:
        description = kernel_tuner.parse(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return Space.load(path), None  # it reports what is wrong with the file
    except RecursionError:
        raise SpaceError(f"{path} is nested too deeply to be a space") from None
    if is_scenario(description):
        scenario = Scenario.from_dict(description, levels)
        return scenario.space, scenario
    if is_configspace(description):
        scenario = read_configspace(description, levels)
        return scenario.space, scenario
    if kernel_tuner.is_kernel_tuner(description):
        scenario = kernel_tuner.read_space(description)
        return scenario.space, scenario
    return Space.from_dict(description), None


def read_resources(texts: Iterable[str]) -> dict[str, list[str]]:
    """Return the items of NAME=A,B texts. Raises ScenarioError for an invalid variable name."""
    resources: dict[str, list[str]] = {}
    for text in texts:
        name, _, items = text.partition("=")
        if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name) or not split(items):
            raise ScenarioError(f"--resource {text!r}: write NAME=A,B with a name that a variable may have")
        if name in resources:
            raise ScenarioError(f"--resource {name} is given twice: list all its items in one")
        resources[name] = split(items)
    return resources


def split(text: str | None) -> list[str]:
    """Return the names in a text that separates them by commas."""
    return [item.strip() for item in (text or "").split(",") if item.strip()]


def count(text: str) -> int:
    """A whole number of 1 or more, for argparse."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of 1 or more")
    return int(text)


def whole(text: str) -> int:
    """A whole number of 0 or more, for argparse."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of 0 or more")
    return int(text)


def port(text: str) -> int:
    """A number of a port, for argparse."""
    if not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text!r} is not a port: 0 to 65535")
    return int(text)


def address(text: str) -> tuple[str, int]:
    """A host and a port, or the port alone on this machine, for argparse."""
    host, colon, number = text.rpartition(":")
    return (host if colon else WORKERS_HOST), port(number)


def seconds(text: str) -> float:
    """A time above 0, for argparse."""
    return _positive(text, "seconds")


def after_hours(text: str) -> float:
    """The moment so many hours from now, in seconds since 1970, for argparse."""
    return time.time() + 3600 * _positive(text, "hours")


def time_of_day(text: str) -> float:
    """The next moment with this local time of day, in seconds since 1970, for argparse."""
    now = datetime.now()
    try:
        moment = datetime.combine(now, datetime.strptime(text, "%H:%M").time())
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a time of day such as 07:00") from None
    return (moment if moment > now else moment + timedelta(days=1)).timestamp()


def _positive(text: str, unit: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of {unit} above 0")
    return number
