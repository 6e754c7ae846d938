"""manage.py move --to URL: move a server from SQLite to PostgreSQL."""

from pathlib import Path
from typing import Any

from django.conf import settings
from django.core.management.base import BaseCommand, CommandError, CommandParser

from crowd.observability.environment import DataFolderError
from crowd.operations import move
from crowd.operations.supervision import exclusive_lock


class Command(BaseCommand):
    help = (
        "Copy the SQLite database of a stopped server to an empty PostgreSQL, and compare all rows. If it "
        "fails or is killed, PostgreSQL stays empty. The file of SQLite is not changed."
    )

    def add_arguments(self, parser: CommandParser) -> None:
        parser.add_argument(
            "--to", required=True, metavar="URL", help="postgresql://USER:PASSWORD@HOST/NAME, without tables"
        )

    def handle(self, *args: Any, to: str, **options: Any) -> None:  # noqa: ARG002
        try:
            with exclusive_lock(Path(settings.FRONTRUNNER_VAR)):
                contents = move.move(to)
        except (move.MoveError, DataFolderError) as error:
            raise CommandError(str(error)) from error
        rows = sum(content.rows for content in contents.values())
        self.stdout.write(
            f"Moved {rows} rows of {len(contents)} tables; all counts and digests are equal. "
            "Now set DATABASE_URL to that address, and start the server."
        )
