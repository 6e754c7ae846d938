"""manage.py exploration: start explorations, see how far they are, steer them, take their results."""

import json
import shlex
import sys
import time
from argparse import ArgumentTypeError
from pathlib import Path
from typing import Any

from django.core.exceptions import ValidationError
from django.core.management.base import BaseCommand, CommandError, CommandParser

from crowd.explorations import exports, publishing, report, services, tasks, watching
from crowd.explorations.models import Exploration, ReferenceDevice
from crowd.fronts import contents, sequences
from pareto.errors import ParetoError
from pareto.methods import DEFAULT, METHODS
from pareto.space import Space

THIS_MACHINE = "this-machine"
LOOK_AGAIN_SECONDS = 5.0


class Command(BaseCommand):
    help = "Start explorations, see how far they are, steer them, take their results."

    def add_arguments(self, parser: CommandParser) -> None:
        commands = parser.add_subparsers(required=True, metavar="COMMAND", dest="act")
        _add_start(commands.add_parser("start", help="begin a new one; a worker of its device measures"))
        status = commands.add_parser("status", help="one line about each, or about one")
        status.add_argument("key", type=int, nargs="?", metavar="KEY")
        status.add_argument("--wait", action="store_true", help="until it is finished, a line when it moved")
        for name, text in {
            "pause": "begin no further measurement",
            "resume": "go on with a paused one",
            "cancel": "measure nothing more of it, for good",
            "retry": "measure once more what failed",
            "report": "print what it found, in Markdown",
        }.items():
            commands.add_parser(name, help=text).add_argument("key", type=int, metavar="KEY")
        budget = commands.add_parser("raise-budget", help="search further, a finished one too")
        budget.add_argument("key", type=int, metavar="KEY")
        budget.add_argument("budget", type=int)
        export = commands.add_parser("export", help="write its evaluations, or its front, to a file")
        export.add_argument("key", type=int, metavar="KEY")
        export.add_argument("--out", type=Path, metavar="FILE", help="evaluations as FILE.csv or FILE.json")
        export.add_argument("--front", type=Path, metavar="FILE", help="<application>-<version>.json")

    def handle(self, *args: Any, act: str, **options: Any) -> None:  # noqa: ARG002
        try:
            if act == "start":
                self._start(options)
            elif act == "status":
                self._status(options["key"], options["wait"])
            else:
                getattr(self, f"_{act.replace('-', '_')}")(_found(options["key"]), options)
        except ValidationError as error:
            raise CommandError("; ".join(error.messages)) from error

    def _start(self, options: dict[str, Any]) -> None:
        exploration = services.create(_wished(options))
        tasks.dispatch(exploration)
        queue = exploration.reference_device.queue
        self._say(f"Started {exploration}; a worker on queue {queue} measures it")
        if options["wait"]:
            self._status(exploration.pk, wait=True)

    def _status(self, key: int | None, wait: bool) -> None:
        if key is None:
            for row in Exploration.objects.order_by("pk").values_list("pk", flat=True):
                self._say(self._line(row))
            return
        told = self._line(_found(key).pk)
        self._say(told)
        while wait and Exploration.objects.get(pk=key).state in {"running", "paused"}:
            time.sleep(LOOK_AGAIN_SECONDS)
            if (line := self._line(key)) != told:
                told = line
                self._say(told)

    def _line(self, key: int) -> str:
        seen = watching.watch(key)
        assert seen is not None
        row = seen.exploration
        words = [
            f"{row} {row.state}: {seen.searched} of {row.budget} searched",
            f"{seen.finished} measured",
            f"{seen.failed} failed",
            f"{len(seen.running)} being measured",
            f"{seen.waiting} waiting",
        ]
        if seen.seconds_left is not None:
            words.append(f"about {seen.seconds_left / 60:.0f} minutes left")
        return ", ".join(words)

    def _pause(self, exploration: Exploration, _: dict[str, Any]) -> None:
        services.pause(exploration)
        self._say(self._line(exploration.pk))

    def _resume(self, exploration: Exploration, _: dict[str, Any]) -> None:
        services.resume(exploration)
        self._go_on(exploration)

    def _cancel(self, exploration: Exploration, _: dict[str, Any]) -> None:
        services.cancel(exploration)
        self._say(self._line(exploration.pk))

    def _retry(self, exploration: Exploration, _: dict[str, Any]) -> None:
        services.retry_failures(exploration)
        self._go_on(exploration)

    def _raise_budget(self, exploration: Exploration, options: dict[str, Any]) -> None:
        services.raise_budget(exploration, options["budget"])
        self._go_on(exploration)

    def _go_on(self, exploration: Exploration) -> None:
        tasks.go_on(exploration)
        self._say(self._line(exploration.pk))

    def _report(self, exploration: Exploration, _: dict[str, Any]) -> None:
        self._say(report.markdown(exploration))

    def _export(self, exploration: Exploration, options: dict[str, Any]) -> None:
        out, front = options["out"], options["front"]
        if out is None and front is None:
            raise CommandError("give --out FILE.csv, --out FILE.json or --front <application>-<version>.json")
        if out is not None:
            lines = {".csv": exports.csv_lines, ".json": exports.json_lines}.get(out.suffix)
            if lines is None:
                raise CommandError(f"--out {out}: name it FILE.csv or FILE.json")
            _write(out, "".join(lines(exploration)))
            self._say(f"{exploration.evaluations.count()} evaluations: {out}")
        if front is not None:
            document = _front(exploration, front)
            _write(front, json.dumps(document, indent=2) + "\n")
            self._say(f"{len(document['configurations'])} points: {front}")

    def _say(self, line: str) -> None:
        self.stdout.write(line)
        self.stdout.flush()


def _add_start(start: CommandParser) -> None:
    start.add_argument("--space", type=Path, required=True, metavar="FILE")
    start.add_argument("--sequence", required=True, metavar="PACK", help="a pack's name or folder")
    start.add_argument("--application", metavar="NAME", help="the system to measure (the space's name)")
    start.add_argument("--budget", type=int, required=True, help="configurations to search")
    start.add_argument("--random", type=int, metavar="N", help="initial random samples (the method's own)")
    start.add_argument("--method", choices=list(METHODS), default=DEFAULT)
    start.add_argument("--batch", type=int, default=8)
    start.add_argument("--seed", type=int, default=0)
    start.add_argument("--points", type=int, default=12, help="of the front, to measure again at the end")
    start.add_argument("--repeats", type=int, default=3, help="further measurements of each such point")
    start.add_argument("--frames", type=int, metavar="N", help="that the search measures (all)")
    start.add_argument("--objectives", type=_names, default=["ate_max", "runtime"], metavar="A,B")
    start.add_argument(
        "--limit",
        type=_limit,
        action="append",
        metavar="NAME=MOST",
        help=f"an upper bound of an objective, repeatable (ate_max={publishing.MAX_ATE})",
    )
    start.add_argument("--device", default=THIS_MACHINE, metavar="NAME", help="a reference device")
    start.add_argument("--opencl", metavar="TEXT", help="the device's OpenCL device from now on")
    start.add_argument("--warm-start", type=int, metavar="KEY", help="an earlier exploration")
    start.add_argument("--asynchronous", action="store_true", help="ask before a whole batch is measured")
    start.add_argument("--no-recheck", action="store_true", help="never measure an outlier again")
    start.add_argument("--wait", action="store_true", help="tell how it goes until it is finished")


def _wished(options: dict[str, Any]) -> Exploration:
    try:
        space = Space.load(options["space"])
    except (ParetoError, OSError) as error:
        raise CommandError(str(error)) from error
    pack = _pack(options["sequence"])
    earlier = options["warm_start"]
    return Exploration(
        application=options["application"] or space.name,
        space=space.to_dict(),
        sequence=pack["name"],
        sequence_sha256=pack["sha256"],
        reference_device=_device(options["device"], options["opencl"]),
        objectives=options["objectives"],
        limits=dict(options["limit"] or [("ate_max", publishing.MAX_ATE)]),
        method=options["method"],
        options={} if options["random"] is None else {"initial": options["random"]},
        warm_start_from=None if earlier is None else _found(earlier),
        synchronous=not options["asynchronous"],
        recheck=not options["no_recheck"],
        command=f"python manage.py {shlex.join(sys.argv[1:])}",
        **{name: options[name] for name in ("seed", "budget", "batch", "points", "repeats", "frames")},
    )


def _found(key: int) -> Exploration:
    exploration = Exploration.objects.select_related("reference_device").filter(pk=key).first()
    if exploration is None:
        raise CommandError(f"no exploration {key}: manage.py exploration status lists them")
    return exploration


def _device(name: str, opencl: str | None) -> ReferenceDevice:
    device = ReferenceDevice.objects.filter(name=name).first()
    if device is None:
        known = ", ".join(ReferenceDevice.objects.values_list("name", flat=True)) or "none yet"
        raise CommandError(f"no reference device {name} (there: {known}): add it in the administration")
    if opencl is not None and device.opencl_device != opencl:
        device.opencl_device = opencl
        device.save(update_fields=["opencl_device"])
    return device


def _pack(wanted: str) -> dict[str, Any]:
    for pack in sequences.packs():
        description: dict[str, Any] = json.loads((pack / "pack.json").read_text())
        if description["name"] == wanted or pack == Path(wanted).absolute():
            return description
    names = ", ".join(pack.name for pack in sequences.packs()) or "none"
    raise CommandError(f"no pack {wanted} in the sequence folders (there: {names})")


def _front(exploration: Exploration, path: Path) -> dict[str, Any]:
    application, _, version = path.stem.rpartition("-")
    if application != exploration.application or not version or path.suffix != ".json":
        raise CommandError(f"--front {path}: name it {exploration.application}-<version>.json")
    try:
        document = publishing.document(exploration, version)
        contents.check(document)
    except (publishing.NothingToPublishError, contents.InvalidFrontError, sequences.SequenceError) as error:
        raise CommandError(f"{exploration}: {error}") from error
    return document


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text)
    except OSError as error:
        raise CommandError(f"{path} cannot be written: {error.strerror}") from error


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",")]


def _limit(text: str) -> tuple[str, float]:
    name, _, most = text.partition("=")
    try:
        return name, float(most)
    except ValueError:
        raise ArgumentTypeError(f"{text}: give NAME=MOST, such as ate_max=0.05") from None
