"""manage.py publish_front FILE ...: what `manage.py front publish FILE ...` is, under its earlier name."""

from pathlib import Path
from typing import Any

from django.core.management import call_command
from django.core.management.base import BaseCommand, CommandParser


class Command(BaseCommand):
    help = "Publish the front of each FILE, as `front publish` does."

    def add_arguments(self, parser: CommandParser) -> None:
        parser.add_argument("files", nargs="+", type=Path, metavar="FILE")

    def handle(self, *args: Any, files: list[Path], **options: Any) -> None:  # noqa: ARG002
        call_command("front", "publish", *map(str, files), stdout=self.stdout)
