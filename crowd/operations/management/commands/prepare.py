"""manage.py prepare [--demo]: the preparation of `serve`, where web server and workers start separately."""

from typing import Any

from django.conf import settings
from django.core.management.base import BaseCommand, CommandError, CommandParser

from crowd.operations import first_run
from crowd.simulation import options as demo_options
from crowd.simulation.transport import RefusedError


class Command(BaseCommand):
    help = "Prepare tables, shipped fronts, the first administrator and static files."

    def add_arguments(self, parser: CommandParser) -> None:
        demo_options.add_arguments(parser)

    def handle(self, *args: Any, demo: bool, devices: int, seed: int, **options: Any) -> None:  # noqa: ARG002
        demo_options.check_arguments(devices, seed)
        host = next(iter(settings.PUBLIC_HOSTS), f"{settings.FRONTRUNNER_BIND}:{settings.FRONTRUNNER_PORT}")
        address = f"{'https' if settings.HTTPS else 'http'}://{host}/"
        try:
            first_run.prepare(self.stdout.write, address, demo)
            if demo:
                from crowd.simulation import filling

                filling.fill(devices, seed, self.stdout.write)
        except (first_run.RealServerError, RefusedError) as error:
            raise CommandError(str(error)) from error
