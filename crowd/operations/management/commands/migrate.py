"""manage.py migrate: Django's command, which applies all migrations or none."""

from typing import Any

from django.core.management.commands import migrate
from django.db import connections

from crowd.database import upgrade


class Command(migrate.Command):
    def handle(self, *args: Any, **options: Any) -> None:
        self.database = options["database"]
        changes = options["app_label"] or upgrade.is_behind(connections[self.database])
        if not changes or options["plan"] or options["check_unapplied"]:
            super().handle(*args, **options)
            return
        with upgrade.all_or_nothing(self.database):
            super().handle(*args, **options)

    def migration_progress_callback(self, action: str, *args: Any, **options: Any) -> None:
        """Report progress; before each migration, check what the one before it stored."""
        if action in ("apply_start", "unapply_start"):
            upgrade.check_constraints(self.database)
        super().migration_progress_callback(action, *args, **options)
