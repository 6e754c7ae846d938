"""manage.py totp USER: set up one-time passwords for an account."""

from typing import Any

from django.contrib.auth import get_user_model
from django.core.management.base import BaseCommand, CommandError, CommandParser
from django_otp.plugins.otp_totp.models import TOTPDevice


class Command(BaseCommand):
    help = "Set up one-time passwords (RFC 6238) for an account; existing ones become invalid."

    def add_arguments(self, parser: CommandParser) -> None:
        parser.add_argument("user", help="name of the account")
        parser.add_argument(
            "--remove", action="store_true", help="remove one-time passwords from the account"
        )

    def handle(self, *args: Any, user: str, remove: bool, **options: Any) -> None:  # noqa: ARG002
        account = get_user_model().objects.filter(username=user).first()
        if account is None:
            raise CommandError(f"there is no account {user!r}: frontrunner admin first_admin makes the first")
        TOTPDevice.objects.filter(user=account).delete()
        if remove:
            self.stdout.write(f"{user} now logs in with only the password")
            return
        device = TOTPDevice.objects.create(user=account, name="app")
        self.stdout.write(
            f"Add this address to an app for one-time passwords; it is shown only now:\n{device.config_url}"
        )
