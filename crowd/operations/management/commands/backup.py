"""manage.py backup FILE: back up a running server to a file."""

from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError, CommandParser

from crowd.operations import backup
from crowd.results.figures import sessions as session_figures


class Command(BaseCommand):
    help = (
        "Write the database and added sequences to FILE, which must not exist. The server may run meanwhile."
    )

    def add_arguments(self, parser: CommandParser) -> None:
        parser.add_argument("file", type=Path)

    def handle(self, *args: Any, file: Path, **options: Any) -> None:  # noqa: ARG002
        try:
            about = backup.make(file)
        except (backup.BackupError, OSError) as error:
            raise CommandError(str(error)) from error
        session_figures.record_pulse(backup.TASK)
        size = file.stat().st_size / 1e6
        self.stdout.write(f"{file}: {about.vendor} database and {len(about.files) - 1} files, {size:.1f} MB")
