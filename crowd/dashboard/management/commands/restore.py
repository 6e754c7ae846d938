"""manage.py restore FILE: a backup into an empty deployment, brought up to this software's version."""

from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError, CommandParser

from crowd.operations import backup, first_run


class Command(BaseCommand):
    help = "Put a backup into a deployment without data; nothing that is there is ever replaced."
    # A check may ask the database, and so make its file.
    requires_system_checks = []

    def add_arguments(self, parser: CommandParser) -> None:
        parser.add_argument("file", type=Path)

    def handle(self, *args: Any, file: Path, **options: Any) -> None:  # noqa: ARG002
        try:
            about = backup.restore(file)
        except (backup.BackupError, OSError) as error:
            raise CommandError(str(error)) from error
        first_run.migrate()
        self.stdout.write(f"Restored what was there at {about.made_at}; start the server with: make serve")
