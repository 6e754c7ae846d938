"""manage.py devices: import catalogues, run better rules over stored strings, look for aliases."""

from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError, CommandParser

from crowd.devices import recognition
from crowd.devices.aliases import decisions
from crowd.devices.catalogue import files, lookup
from crowd.devices.models import DeviceAlias, DeviceDescription, DeviceModel
from crowd.devices.signals import models_changed

SHOWN_BAD_LINES = 20


class Command(BaseCommand):
    help = "Import device catalogues, derive models again, propose aliases."

    def add_arguments(self, parser: CommandParser) -> None:
        commands = parser.add_subparsers(required=True, metavar="COMMAND", dest="act")
        files = commands.add_parser(
            "import", help="Google Play's device catalogue or a list of model names, as CSV"
        )
        files.add_argument("file", type=Path, metavar="FILE")
        commands.add_parser("renormalise", help="run the present rules over all stored strings")
        commands.add_parser("propose", help="look for names of one device among all models")
        commands.add_parser("status", help="how many there are of each kind, and what waits for a person")

    def handle(self, *args: Any, act: str, **options: Any) -> None:  # noqa: ARG002
        if act == "import":
            self._import(options["file"])
        if act in ("import", "renormalise"):
            self._renormalise()
        if act != "status":
            self._say(f"{decisions.propose_all_aliases()} new proposals of aliases")
        else:
            self._status()

    def _import(self, path: Path) -> None:
        try:
            done = lookup.store(files.read(path))
        except (OSError, files.CatalogueFileError) as error:
            raise CommandError(str(error)) from error
        for bad in done.bad[:SHOWN_BAD_LINES]:
            self._say(f"line {bad.number}: {bad.reason}")
        if len(done.bad) > SHOWN_BAD_LINES:
            self._say(f"... and {len(done.bad) - SHOWN_BAD_LINES} more such lines")
        self._say(
            f"{done.read} lines: {done.new} new, {done.changed} changed, {done.same} as before, "
            f"{len(done.bad)} not taken"
        )

    def _renormalise(self) -> None:
        before = DeviceModel.objects.filter(descriptions__isnull=False).distinct().count()
        count = recognition.renormalise(DeviceDescription.objects.all())
        after = DeviceModel.objects.filter(descriptions__isnull=False).distinct().count()
        # The threshold of what is rare may have changed too, which is counted where sessions are known.
        models_changed.send(sender=DeviceModel, keys=recognition.mark_all())
        self._say(f"{count} descriptions: {before} models before, {after} after")

    def _status(self) -> None:
        for kind in DeviceModel.Kind:
            self._say(f"{DeviceModel.objects.filter(kind=kind).count()} {kind.label}")
        waiting = DeviceAlias.objects.filter(state=DeviceAlias.State.PROPOSED).count()
        unknown = DeviceModel.objects.filter(kind=DeviceModel.Kind.UNKNOWN, judged_by="").count()
        self._say(f"to review: {waiting} proposed aliases, {unknown} unknown devices")

    def _say(self, line: str) -> None:
        self.stdout.write(line)
