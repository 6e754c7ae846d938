"""manage.py totp USER: one-time passwords for an account of the administration."""

from typing import Any

from django.contrib.auth import get_user_model
from django.core.management.base import BaseCommand, CommandError, CommandParser
from django_otp.plugins.otp_totp.models import TOTPDevice


class Command(BaseCommand):
    help = "Set up one-time passwords (RFC 6238) for an account; its earlier ones end."

    def add_arguments(self, parser: CommandParser) -> None:
        parser.add_argument("user", help="name of the account")
        parser.add_argument("--remove", action="store_true", help="let the account in without them again")

    def handle(self, *args: Any, user: str, remove: bool, **options: Any) -> None:  # noqa: ARG002
        account = get_user_model().objects.filter(username=user).first()
        if account is None:
            raise CommandError(f"there is no account {user!r}: manage.py first_admin makes the first")
        TOTPDevice.objects.filter(user=account).delete()
        if remove:
            self.stdout.write(f"{user} logs in with the password alone")
            return
        device = TOTPDevice.objects.create(user=account, name="app")
        self.stdout.write(
            f"Add this address to an app for one-time passwords; it is shown only now:\n{device.config_url}"
        )
