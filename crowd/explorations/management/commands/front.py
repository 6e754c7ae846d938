"""manage.py front export | import | prepare | publish | retire: fronts without a browser."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from django.core.exceptions import ValidationError
from django.core.management.base import BaseCommand, CommandError, CommandParser

from crowd.audit.services import COMMAND_LINE
from crowd.explorations import steering
from crowd.explorations.management.cli_options import find_device
from crowd.explorations.management.measuring_here import measure_here
from crowd.explorations.measuring import reaping
from crowd.fronts import selectors
from crowd.fronts.content import front_file
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing import preview, services
from wire.front import Front


class Command(BaseCommand):
    help = "Write fronts to files, read drafts from files, prepare, publish and retire."

    def add_arguments(self, parser: CommandParser) -> None:
        acts = parser.add_subparsers(
            dest="act", required=True, metavar="export|import|prepare|publish|retire"
        )
        export = acts.add_parser("export", help="write a front in any state as a file that can be imported")
        export.add_argument("version", metavar="VERSION", help="such as kfusion-1")
        export.add_argument("--out", type=Path, metavar="FILE", help="output file; default: standard output")
        read = acts.add_parser("import", help="make a draft of the front in each FILE")
        read.add_argument("files", nargs="+", type=Path, metavar="FILE")
        prepare = acts.add_parser(
            "prepare", help="measure what clients need of a draft; of a released front, of its next version"
        )
        prepare.add_argument("version", metavar="VERSION")
        prepare.add_argument("--device", metavar="NAME", help="the reference device that times the points")
        publish = acts.add_parser("publish", help="publish files, drafts, or fronts in review")
        publish.add_argument("fronts", nargs="+", metavar="FILE|VERSION")
        publish.add_argument("--yes", action="store_true", help="publish without asking")
        retire = acts.add_parser("retire", help="stop clients from measuring these fronts")
        retire.add_argument("versions", nargs="+", metavar="VERSION")

    def handle(self, *args: Any, act: str, **options: Any) -> None:  # noqa: ARG002
        try:
            if act == "export":
                self._export(options["version"], options["out"])
            elif act == "import":
                self._each(options["files"], self._import)
            elif act == "prepare":
                self._prepare(options["version"], options["device"])
            elif act == "publish":
                self.yes = options["yes"]
                self._each(options["fronts"], self._publish)
            else:
                self._each(options["versions"], self._retire)
        except (*services.REFUSALS, ValidationError) as error:
            # The text of a ValidationError is that of a list.
            raise CommandError("; ".join(getattr(error, "messages", [str(error)]))) from error

    def _each(self, names: list[Any], act: Callable[[Any], str]) -> None:
        for name in names:
            self.stdout.write(act(name))

    def _export(self, version: str, out: Path | None) -> None:
        front = selectors.front_in_any_state(self._found(version).pk)
        services.check_digest(front)
        text = front_file.text(selectors.content(front))
        if out is None:
            self.stdout.write(text, ending="")
            return
        try:
            out.write_text(text)
        except OSError as error:
            raise CommandError(f"{out} cannot be written: {error.strerror}") from error
        self.stdout.write(f"{front.slug}: {out}")

    def _import(self, path: Path) -> str:
        front = services.import_file(path)
        step = "publish" if services.is_prepared(front) else "prepare"
        return (
            f"{front.slug}: imported as a draft; {step} it with: frontrunner admin front {step} {front.slug}"
        )

    def _prepare(self, version: str, device: str | None) -> None:
        chosen = None if device is None else find_device(device)
        begun = steering.prepare(self._found(version), COMMAND_LINE, chosen)
        slug = str(begun.prepares)
        self._say(
            f"Preparing {slug} on {begun.reference_device}; "
            f"to continue: frontrunner admin front prepare {slug}"
        )
        reaping.reap_after_restart()
        measure_here(begun, self._say)
        left_out = FrontVersion.objects.get(slug=slug).content.provenance["prepared"]["left_out"]
        for name, why in left_out.items():
            self._say(f"left out: {name}: {why}")
        self._say(f"{slug}: prepared; publish it with: frontrunner admin front publish {slug}")

    def _say(self, line: str) -> None:
        self.stdout.write(line)
        self.stdout.flush()

    def _publish(self, name: str) -> str:
        if name.endswith(".json") or Path(name).exists():
            return self._publish_file(Path(name))
        front = self._found(name)
        if not self._confirmed(selectors.front_in_any_state(front.pk)):
            return f"{front.slug}: not published"
        if front.state == FrontVersion.State.DRAFT:
            services.submit(front)
        return f"{services.publish(front).slug}: published"

    def _publish_file(self, path: Path) -> str:
        document = front_file.read(path)
        try:
            if (before := services.published(document)) is not None:
                return f"{before.slug}: already published, nothing changed"
            new = selectors.of_content(front_file.check(document))
            if not self._confirmed(new):
                return f"{new.slug}: not published"
            return f"{services.publish_content(document)[0].slug}: published"
        except services.REFUSALS as error:
            raise type(error)(f"{path}: {error}") from error

    def _confirmed(self, new: Front) -> bool:
        """Show what changes, and ask whether to publish `new`."""
        for line in preview.lines(preview.preview(new)):
            self.stdout.write(line)
        if self.yes:
            return True
        if not sys.stdin.isatty():
            raise CommandError(f"{new.slug}: cannot ask without a terminal: add --yes to publish it")
        self.stdout.write(f"Publish {new.slug}? [y/N] ", ending="")
        self.stdout.flush()
        return sys.stdin.readline().strip().lower() in {"y", "yes"}

    def _retire(self, version: str) -> str:
        return f"{services.retire(self._found(version)).slug}: retired"

    def _found(self, version: str) -> FrontVersion:
        front = FrontVersion.objects.filter(slug=version).first()
        if front is None:
            slugs = ", ".join(FrontVersion.objects.order_by("slug").values_list("slug", flat=True))
            raise CommandError(f"no front {version}: choose from {slugs or 'none'}")
        return front
