"""manage.py prepare: the preparation of `serve`, for servers that start web server and workers separately."""

from typing import Any

from django.conf import settings
from django.core.management.base import BaseCommand

from crowd.operations import first_run


class Command(BaseCommand):
    help = "Prepare tables, shipped fronts, the first administrator and static files."

    def handle(self, *args: Any, **options: Any) -> None:  # noqa: ARG002
        host = next(iter(settings.PUBLIC_HOSTS), f"{settings.FRONTRUNNER_BIND}:{settings.FRONTRUNNER_PORT}")
        first_run.prepare(self.stdout.write, f"{'https' if settings.HTTPS else 'http'}://{host}/")
