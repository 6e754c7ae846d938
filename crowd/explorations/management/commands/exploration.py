"""manage.py exploration: start and steer explorations, show their progress, export and import them."""

import time
from pathlib import Path
from typing import Any

from django.core.exceptions import ValidationError
from django.core.management.base import BaseCommand, CommandError, CommandParser
from django.db import transaction

from crowd.audit.services import COMMAND_LINE
from crowd.explorations import selectors, steering
from crowd.explorations.management import files
from crowd.explorations.management.cli_options import (
    add_exploration_options,
    exploration_from,
    find_device,
    find_exploration,
)
from crowd.explorations.measuring import reference_devices
from crowd.explorations.models import Exploration
from crowd.explorations.outcomes import exports, importing, report, watching
from slam.devices.device import BACKENDS

LOOK_AGAIN_SECONDS = 5.0


class Command(BaseCommand):
    help = "Start and steer explorations, show their progress, export and import them."

    def add_arguments(self, parser: CommandParser) -> None:
        commands = parser.add_subparsers(required=True, metavar="COMMAND", dest="act")
        _add_start(commands.add_parser("start", help="start a new one; a worker of its device measures"))
        status = commands.add_parser("status", help="a line about each, or about one")
        status.add_argument("key", type=int, nargs="?", metavar="KEY")
        status.add_argument("--wait", action="store_true", help="print a line at each change until it ends")
        for name, text in {
            "pause": "start no further measurements",
            "resume": "continue a paused one",
            "cancel": "end it; results stay",
            "retry": "measure failures again",
            "report": "print its results in Markdown",
        }.items():
            commands.add_parser(name, help=text).add_argument("key", type=int, metavar="KEY")
        budget = commands.add_parser("raise-budget", help="search more configurations")
        budget.add_argument("key", type=int, metavar="KEY")
        budget.add_argument("budget", metavar="BUDGET")
        export = commands.add_parser("export", help="write it, its evaluations, or its front, to a file")
        export.add_argument("key", type=int, metavar="KEY")
        export.add_argument(
            "--out",
            type=Path,
            metavar="FILE",
            help="all of it as FILE.json.gz, evaluations as FILE.csv or FILE.json",
        )
        export.add_argument(
            "--machine",
            default="",
            metavar="NAME",
            help="name of the machine in FILE.json.gz, which becomes public (default: its host name)",
        )
        export.add_argument("--front", type=Path, metavar="FILE", help="<application>-<version>.json")
        read = commands.add_parser("import", help="show an exploration of another server, from FILE.json.gz")
        read.add_argument("files", nargs="+", type=Path, metavar="FILE")

    def handle(self, *args: Any, act: str, **options: Any) -> None:  # noqa: ARG002
        try:
            if act == "start":
                self._start(options)
            elif act == "status":
                self._status(options["key"], options["wait"])
            elif act == "import":
                for path in options["files"]:
                    self._import(path)
            elif act in {"report", "export"}:
                getattr(self, f"_{act}")(find_exploration(options["key"]), options)
            elif act == "raise-budget":
                self._steer("raise", find_exploration(options["key"]), options["budget"])
            else:
                self._steer(act, find_exploration(options["key"]))
        except ValidationError as error:
            raise CommandError("; ".join(error.messages)) from error

    def _start(self, options: dict[str, Any]) -> None:
        device = find_device(options["device"])
        with transaction.atomic():
            reference_devices.change_device(device, options["backend"], options["opencl"])
            exploration = steering.start(
                exploration_from(options, device, options["application"]), COMMAND_LINE, options["known"]
            )
        queue = exploration.reference_device.queue
        self._say(f"Started {exploration}; a worker on queue {queue} measures it")
        if options["wait"]:
            self._status(exploration.pk, wait=True)

    def _status(self, key: int | None, wait: bool) -> None:
        if key is None:
            for row in Exploration.objects.order_by("pk").values_list("pk", flat=True):
                self._say(self._line(row))
            return
        shown = self._line(find_exploration(key).pk)
        self._say(shown)
        while wait and Exploration.objects.get(pk=key).state in {"running", "paused"}:
            time.sleep(LOOK_AGAIN_SECONDS)
            if (line := self._line(key)) != shown:
                shown = line
                self._say(line)

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
        if machine := row.reference_device.elsewhere:
            words.append(f"elsewhere, on {machine}")
        if seen.seconds_left is not None:
            words.append(f"about {seen.seconds_left / 60:.0f} minutes left")
        return ", ".join(words) + (f": {row.note}" if row.note else "")

    def _steer(self, name: str, exploration: Exploration, budget: str = "") -> None:
        steering.take_step(name, exploration, COMMAND_LINE, budget)
        self._say(self._line(exploration.pk))

    def _report(self, exploration: Exploration, _: dict[str, Any]) -> None:
        self._say(report.markdown(exploration))

    def _export(self, exploration: Exploration, options: dict[str, Any]) -> None:
        out, front = options["out"], options["front"]
        if out is None and front is None:
            raise CommandError(
                "give --out FILE.json.gz, FILE.csv or FILE.json, or --front <application>-<version>.json"
            )
        if out is not None and out.name.endswith(".json.gz"):
            self._say(files.write_whole(exploration, out, options["machine"]))
        elif out is not None:
            lines = {".csv": exports.csv_lines, ".json": exports.json_lines}.get(out.suffix)
            if lines is None:
                raise CommandError(f"--out {out}: name it FILE.json.gz, FILE.csv or FILE.json")
            files.write(out, "".join(lines(exploration, staff=True)))
            self._say(f"{len(selectors.numbers(exploration))} evaluations: {out}")
        if front is not None:
            self._say(files.write_front(exploration, front))

    def _import(self, path: Path) -> None:
        try:
            exploration = importing.import_file(path)
        except importing.REFUSALS as error:
            raise CommandError(str(error)) from error
        count = exploration.evaluations.count()
        machine = exploration.reference_device.elsewhere
        self._say(f"{path}: imported as {exploration}: {count} evaluations, measured on {machine}")

    def _say(self, line: str) -> None:
        self.stdout.write(line)
        self.stdout.flush()


def _add_start(start: CommandParser) -> None:
    add_exploration_options(start)
    start.add_argument("--application", metavar="NAME", help="the system to measure (the space's name)")
    start.add_argument(
        "--device", default=reference_devices.THIS_MACHINE, metavar="NAME", help="a reference device"
    )
    start.add_argument("--backend", choices=BACKENDS, help="change the backend of the device")
    start.add_argument("--opencl", metavar="TEXT", help="change the backend's device (part of its name)")
    start.add_argument("--wait", action="store_true", help="show the progress until it is finished")
