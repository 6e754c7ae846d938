"""manage.py publish_front FILE ...: the old name of `manage.py front publish FILE ...`."""

from pathlib import Path
from typing import Any

from django.core.management import call_command
from django.core.management.base import BaseCommand, CommandParser


class Command(BaseCommand):
    help = "Publish the front of each FILE, as `front publish` does."

    def add_arguments(self, parser: CommandParser) -> None:
        parser.add_argument("files", nargs="+", type=Path, metavar="FILE")
        parser.add_argument("--yes", action="store_true", help="publish without asking")

    def handle(self, *args: Any, files: list[Path], yes: bool, **options: Any) -> None:  # noqa: ARG002
        call_command("front", "publish", *map(str, files), *(["--yes"] if yes else []), stdout=self.stdout)
