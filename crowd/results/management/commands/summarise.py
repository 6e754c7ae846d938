"""manage.py summarise [--all]: compute summaries here and now, without a worker."""

from typing import Any

from django.core.management.base import BaseCommand, CommandParser

from crowd.results import summarising
from crowd.results.models import MeasurementSession


class Command(BaseCommand):
    help = "Summarise the sessions that wait; with --all every session, from its raw runs."

    def add_arguments(self, parser: CommandParser) -> None:
        parser.add_argument("--all", action="store_true", help="compute every summary and figure anew")

    def handle(self, *args: Any, **options: Any) -> None:  # noqa: ARG002
        if options["all"]:
            MeasurementSession.objects.update(summary_algorithm=None)
        self.stdout.write(f"{summarising.summarise_waiting()} sessions summarised")
