"""manage.py flush: Django's command, which empties every table, the audit log too."""

from typing import Any

from django.core.management.commands import flush

from crowd.audit import guards


class Command(flush.Command):
    def handle(self, **options: Any) -> None:
        guards.drop(options["database"])
        try:
            super().handle(**options)
        finally:
            guards.create(options["database"])
