"""manage.py restore FILE: restore a backup into an empty server, and migrate it."""

from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError, CommandParser

from crowd.database.upgrade import migrate
from crowd.demo import mark
from crowd.operations import backup


class Command(BaseCommand):
    help = "Restore a backup into a server without data. Existing data is never replaced."

    def add_arguments(self, parser: CommandParser) -> None:
        parser.add_argument("file", type=Path)

    def handle(self, *args: Any, file: Path, **options: Any) -> None:  # noqa: ARG002
        try:
            about = backup.restore(file)
        except (backup.BackupError, OSError) as error:
            raise CommandError(str(error)) from error
        migrate()
        self.stdout.write(f"Restored the state of {about.made_at}; now start the server")
        if mark.is_demo():
            self.stdout.write(mark.SENTENCE)
