"""manage.py publish_front FILE ...: publish fronts from files; what is published already stays as it is."""

from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError, CommandParser

from crowd.fronts import contents, sequences, services


class Command(BaseCommand):
    help = "Publish the front of each FILE (fixtures/fronts/<application>-<version>.json)."

    def add_arguments(self, parser: CommandParser) -> None:
        parser.add_argument("files", nargs="+", type=Path, metavar="FILE")

    def handle(self, *args: Any, files: list[Path], **options: Any) -> None:  # noqa: ARG002
        for path in files:
            try:
                front, new = services.publish_file(path)
            except (
                contents.InvalidFrontError,
                sequences.SequenceError,
                services.FrontConflictError,
            ) as error:
                raise CommandError(str(error)) from error
            self.stdout.write(
                f"{front.slug}: {'published' if new else 'was published before, nothing changed'}"
            )
