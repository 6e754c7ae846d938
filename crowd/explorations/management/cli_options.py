"""Command-line options to create an exploration."""

import json
import shlex
import sys
from argparse import ArgumentTypeError
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from django.core.management.base import CommandError, CommandParser

from crowd.explorations.models import Exploration, ReferenceDevice
from crowd.explorations.objectives import RATIO
from crowd.explorations.searching.applications import SEVERAL, SYSTEM
from crowd.fronts import sequences
from pareto.errors import ParetoError
from pareto.search.methods import DEFAULT, METHODS
from pareto.spaces.space import Space
from wire.protocol import VALID_BELOW

LIMITED = "ate_max"  # limited to VALID_BELOW by default
NUMBERS = ("seed", "budget", "batch", "points", "repeats", "frames")


def add_exploration_options(parser: CommandParser) -> None:
    """Add the options of an exploration, except where to measure it."""
    parser.add_argument("--space", type=Path, required=True, metavar="FILE")
    parser.add_argument(
        "--sequence",
        required=True,
        action="append",
        metavar="PACK",
        help="name or folder of a pack; repeat it to learn on several: clients measure on the first",
    )
    parser.add_argument(
        "--held-out",
        action="append",
        default=[],
        metavar="PACK",
        help="a sequence that is not learned on, repeatable: the points found are checked on it",
    )
    parser.add_argument(
        "--quantile",
        type=float,
        default=1.0,
        metavar="Q",
        help="which of the errors on the sequences counts (1: the worst)",
    )
    parser.add_argument("--budget", type=int, required=True, help="configurations to search")
    parser.add_argument("--random", type=int, metavar="N", help="initial random samples (the method's)")
    parser.add_argument("--method", choices=list(METHODS), default=DEFAULT)
    parser.add_argument("--batch", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--points", type=int, default=12, help="points of the front to repeat at the end")
    parser.add_argument("--repeats", type=int, default=3, help="further measurements of each of these points")
    parser.add_argument("--frames", type=int, metavar="N", help="frames that the search measures (all)")
    parser.add_argument("--objectives", type=_names, default=["ate_max", RATIO], metavar="A,B")
    limits = parser.add_mutually_exclusive_group()
    limits.add_argument(
        "--limit",
        type=_limit,
        action="append",
        metavar="NAME=MOST",
        help=f"an upper bound of an objective, repeatable ({LIMITED}={VALID_BELOW})",
    )
    limits.add_argument("--no-limits", action="store_true", help="no limits of objectives")
    parser.add_argument("--warm-start", type=int, metavar="KEY", help="an earlier exploration")
    parser.add_argument(
        "--known",
        type=_known,
        default=[],
        metavar="FILE",
        help="a front file, or a JSON list of configurations: measured before the search",
    )
    parser.add_argument("--asynchronous", action="store_true", help="propose more before a batch is finished")
    parser.add_argument("--no-recheck", action="store_true", help="never measure an outlier again")


def exploration_from(
    options: dict[str, Any], device: ReferenceDevice, application: str | None = None
) -> Exploration:
    """An unsaved exploration with `options` on `device`. Raises CommandError.

    `application`: the system to measure; None: that in the name of the space. A space over several systems
    says itself which one runs a configuration.
    """
    try:
        space = Space.load(options["space"])
    except (ParetoError, OSError) as error:
        raise CommandError(str(error)) from error
    pack, *further = map(_pack, options["sequence"])
    earlier = options["warm_start"]
    return Exploration(
        application=SEVERAL if SYSTEM in space.names else application or space.name,
        space=space.to_dict(),
        sequence=pack["name"],
        sequence_sha256=pack["sha256"],
        further_sequences=[_named(other) for other in further],
        held_out_sequences=[_named(_pack(name)) for name in options["held_out"]],
        error_quantile=options["quantile"],
        reference_device=device,
        objectives=options["objectives"],
        limits=_limits(options),
        method=options["method"],
        options={} if options["random"] is None else {"initial": options["random"]},
        warm_start_from=None if earlier is None else find_exploration(earlier),
        synchronous=not options["asynchronous"],
        recheck=not options["no_recheck"],
        command=command_line(),
        **{name: options[name] for name in NUMBERS},
    )


def find_device(name: str) -> ReferenceDevice:
    """The reference device `name`. Raises CommandError, which lists the known ones."""
    here = ReferenceDevice.objects.filter(elsewhere="")
    device = here.filter(name=name).first()
    if device is None:
        names = ", ".join(here.values_list("name", flat=True)) or "none yet"
        raise CommandError(f"no reference device {name} (known: {names}): add it in the administration")
    return device


def find_exploration(key: int) -> Exploration:
    """The exploration `key`. Raises CommandError if it does not exist."""
    exploration = Exploration.objects.select_related("reference_device").filter(pk=key).first()
    if exploration is None:
        raise CommandError(f"no exploration {key}: frontrunner admin exploration status lists them")
    return exploration


def command_line() -> str:
    """The current command line, to be typed again."""
    return f"python manage.py {shlex.join(sys.argv[1:])}"


def _known(path: str) -> list[dict[str, Any]]:
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ArgumentTypeError(f"{path} cannot be read as JSON: {error}") from error
    points = content.get("configurations") if isinstance(content, dict) else content
    if not isinstance(points, list) or not all(isinstance(point, dict) for point in points):
        raise ArgumentTypeError(f"{path} is neither a front file nor a list of configurations")
    return [point.get("parameters", point) for point in points]


def _limits(options: dict[str, Any]) -> dict[str, float]:
    if options["no_limits"]:
        return {}
    if options["limit"]:
        return dict(options["limit"])
    if LIMITED not in options["objectives"]:
        raise CommandError(
            f"objectives {', '.join(options['objectives'])} lack {LIMITED}, whose default limit "
            f"is {VALID_BELOW}: add it to --objectives, or give --limit NAME=MOST or "
            "--no-limits"
        )
    return {LIMITED: VALID_BELOW}


def _pack(wanted: str) -> dict[str, Any]:
    descriptions = {pack: sequences.read_description(pack) for pack in sequences.packs()}
    for pack, description in descriptions.items():
        if description["name"] == wanted or pack == Path(wanted).absolute():
            return description
    names = ", ".join(sorted(description["name"] for description in descriptions.values())) or "none"
    raise CommandError(f"no pack {wanted} in the sequence folders (there: {names})")


def _named(pack: Mapping[str, Any]) -> dict[str, str]:
    return {"name": pack["name"], "sha256": pack["sha256"]}


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",")]


def _limit(text: str) -> tuple[str, float]:
    name, _, most = text.partition("=")
    try:
        return name, float(most)
    except ValueError:
        raise ArgumentTypeError(f"{text}: give NAME=MOST, such as ate_max=0.05") from None
