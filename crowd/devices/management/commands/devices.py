"""manage.py devices: import catalogues, apply new rules to stored strings, look for aliases."""

from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError, CommandParser

from crowd.devices import catalogue, recognition
from crowd.devices.aliases import decisions
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
        commands.add_parser("renormalise", help="apply the current rules to all stored strings")
        commands.add_parser("propose", help="look for aliases among all models")
        commands.add_parser("status", help="count models by kind, and what waits for review")

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
            done = catalogue.store(catalogue.read(path))
        except (OSError, catalogue.CatalogueFileError) as error:
            raise CommandError(str(error)) from error
        for bad in done.bad[:SHOWN_BAD_LINES]:
            self._say(f"line {bad.number}: {bad.reason}")
        if len(done.bad) > SHOWN_BAD_LINES:
            self._say(f"... and {len(done.bad) - SHOWN_BAD_LINES} more such lines")
        self._say(
            f"{done.read} lines: {done.new} new, {done.changed} changed, {done.same} unchanged, "
            f"{len(done.bad)} invalid"
        )

    def _renormalise(self) -> None:
        before = DeviceModel.objects.filter(descriptions__isnull=False).distinct().count()
        count = recognition.renormalise(DeviceDescription.objects.all())
        after = DeviceModel.objects.filter(descriptions__isnull=False).distinct().count()
        # The threshold of rare models may have changed too; models are counted again with their sessions.
        models_changed.send(sender=DeviceModel, keys=recognition.mark_all_changed())
        self._say(f"{count} descriptions: {before} models before, {after} after")

    def _status(self) -> None:
        for kind in DeviceModel.Kind:
            self._say(f"{DeviceModel.objects.filter(kind=kind).count()} {kind.label}")
        waiting = DeviceAlias.objects.filter(state=DeviceAlias.State.PROPOSED).count()
        unknown = DeviceModel.objects.filter(kind=DeviceModel.Kind.UNKNOWN, judged_by="").count()
        self._say(f"to review: {waiting} proposed aliases, {unknown} unknown devices")

    def _say(self, line: str) -> None:
        self.stdout.write(line)
