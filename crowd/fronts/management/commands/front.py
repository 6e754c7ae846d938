"""manage.py front export | import | publish | retire: fronts from and to files, without a browser."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from django.core.exceptions import ValidationError
from django.core.management.base import BaseCommand, CommandError, CommandParser

from crowd.fronts import contents, selectors, services
from crowd.fronts.models import FrontVersion


class Command(BaseCommand):
    help = "Write fronts to files, read drafts from files, publish and retire."

    def add_arguments(self, parser: CommandParser) -> None:
        acts = parser.add_subparsers(dest="act", required=True, metavar="export|import|publish|retire")
        export = acts.add_parser("export", help="write a front, in whatever state, as a file that imports")
        export.add_argument("version", metavar="VERSION", help="as in kfusion-1")
        export.add_argument("--out", type=Path, metavar="FILE", help="else on the standard output")
        read = acts.add_parser("import", help="make a draft of the front in each FILE")
        read.add_argument("files", nargs="+", type=Path, metavar="FILE")
        publish = acts.add_parser("publish", help="publish files, or drafts and what is in review")
        publish.add_argument("fronts", nargs="+", metavar="FILE|VERSION")
        retire = acts.add_parser("retire", help="no client is told of these any more")
        retire.add_argument("versions", nargs="+", metavar="VERSION")

    def handle(self, *args: Any, act: str, **options: Any) -> None:  # noqa: ARG002
        try:
            if act == "export":
                self._export(options["version"], options["out"])
            elif act == "import":
                self._each(options["files"], self._import)
            elif act == "publish":
                self._each(options["fronts"], self._publish)
            else:
                self._each(options["versions"], self._retire)
        except (*services.REFUSALS, ValidationError) as error:
            # A ValidationError's own text is a list's.
            raise CommandError("; ".join(getattr(error, "messages", [str(error)]))) from error

    def _each(self, names: list[Any], act: Callable[[Any], str]) -> None:
        for name in names:
            self.stdout.write(act(name))

    def _export(self, version: str, out: Path | None) -> None:
        front = selectors.any_front(self._found(version).pk)
        services.refuse_altered(front)
        text = contents.text(selectors.document(front))
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
        return f"{front.slug}: a draft now, manage.py front publish {front.slug} makes clients measure it"

    def _publish(self, name: str) -> str:
        if name.endswith(".json") or Path(name).exists():
            front, new = services.publish_file(Path(name))
            return f"{front.slug}: {'published' if new else 'was published before, nothing changed'}"
        front = self._found(name)
        if front.state == FrontVersion.State.DRAFT:
            services.submit(front)
        return f"{services.publish(front).slug}: published"

    def _retire(self, version: str) -> str:
        return f"{services.retire(self._found(version)).slug}: retired"

    def _found(self, version: str) -> FrontVersion:
        front = FrontVersion.objects.filter(slug=version).first()
        if front is None:
            there = ", ".join(FrontVersion.objects.order_by("slug").values_list("slug", flat=True))
            raise CommandError(f"no front {version} (there: {there or 'none'})")
        return front
