"""manage.py first_admin: create the first administrator and print the password once."""

from typing import Any

from django.core.management.base import BaseCommand

from crowd.database.upgrade import migrate
from crowd.operations.first_run import ADMINISTRATOR, create_first_administrator


class Command(BaseCommand):
    help = "Create an administrator if there is none, and print the password."

    def handle(self, *args: Any, **options: Any) -> None:  # noqa: ARG002
        migrate()
        password = create_first_administrator()
        if password is None:
            self.stdout.write(
                "There is an administrator already; frontrunner admin changepassword NAME sets a password."
            )
            return
        self.stdout.write(f"Administrator: user {ADMINISTRATOR}, password {password} (shown only now)")
