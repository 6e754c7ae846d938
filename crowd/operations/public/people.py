"""Checks of accounts, and of what only a person can confirm."""

from collections.abc import Iterator
from dataclasses import dataclass

from django.conf import settings
from django.contrib.auth import get_user_model
from django.contrib.auth.models import AbstractUser, Permission
from django.db.models import Q, QuerySet
from django_otp.plugins.otp_totp.models import TOTPDevice

from crowd.audit.models import AuditEntry
from crowd.audit.services import record
from crowd.fronts.publishing.steps import PUBLISH
from crowd.operations.public.check_result import CheckResult, passed, to_do

MOST_NAMES = 5


@dataclass(frozen=True)
class Confirmation:
    """A statement that a person confirms in the audit log, for one version of the consent text."""

    name: str
    title: str
    action: str
    finding: str
    remedy: str

    @property
    def subject(self) -> str:
        """The subject of the log entry. A new consent text needs a new confirmation."""
        return f"{self.name}, consent {settings.FRONTRUNNER_CONSENT_VERSION}"


CONFIRMATIONS = {
    one.name: one
    for one in (
        Confirmation(
            "privacy",
            "Privacy text",
            "privacy text reviewed",
            "not yet confirmed",
            "read /about/#privacy, the consent on /measure/ and docs/privacy.md. If they are true for "
            "your proxy, your logs and your law, confirm it in the administration",
        ),
        Confirmation(
            "passwords",
            "First password",
            "first password changed",
            "not yet confirmed",
            "change the password that the first start printed (frontrunner admin changepassword admin), then "
            "confirm it in the administration",
        ),
    )
}


def run() -> Iterator[CheckResult]:
    """Check accounts and confirmations."""
    yield _one_time_passwords()
    yield _second_person()
    for confirmation in CONFIRMATIONS.values():
        yield _confirmed(confirmation)


def confirm(name: str, by: str) -> None:
    """Log that `by` confirms `name`. Raises KeyError if `name` is not in CONFIRMATIONS."""
    confirmation = CONFIRMATIONS[name]
    record(by, confirmation.action, confirmation.subject)


def _confirmed(confirmation: Confirmation) -> CheckResult:
    entry = AuditEntry.objects.filter(subject=confirmation.subject, action=confirmation.action).first()
    if entry is None:
        return to_do(confirmation.title, confirmation.finding, confirmation.remedy, confirmation.name)
    return passed(confirmation.title, f"confirmed by {entry.actor} on {entry.at:%Y-%m-%d}")


def _staff() -> QuerySet[AbstractUser]:
    return get_user_model().objects.filter(is_active=True, is_staff=True)


def _one_time_passwords() -> CheckResult:
    title = "One-time passwords"
    devices = TOTPDevice.objects.filter(confirmed=True).values("user")
    without = list(_staff().exclude(pk__in=devices).order_by("pk").values_list("username", flat=True))
    if without:
        names = ", ".join(without[:MOST_NAMES]) + (" and others" if len(without) > MOST_NAMES else "")
        remedy = "frontrunner admin totp USER for each, then FRONTRUNNER_REQUIRE_TOTP=1"
        return to_do(title, f"a password alone lets in {names}", remedy)
    if not settings.FRONTRUNNER_REQUIRE_TOTP:
        remedy = "set FRONTRUNNER_REQUIRE_TOTP=1"
        return to_do(title, "all accounts have one, but a new account would not need it", remedy)
    return passed(title, f"all {_staff().count()} accounts of the administration need them")


def _second_person() -> CheckResult:
    title, publishers = "Second person", _publishers().count()
    if not settings.FRONTRUNNER_SECOND_PERSON:
        remedy = "set FRONTRUNNER_SECOND_PERSON=1: then a front needs a second person to publish it"
        return to_do(title, "one person alone can publish a front", remedy)
    if publishers < 2:
        remedy = "give a second person an account in the group publisher"
        finding = f"{publishers} account can publish, and never its own fronts"
        return to_do(title, finding, remedy)
    return passed(title, f"{publishers} accounts can publish, none its own fronts")


def _publishers() -> QuerySet[AbstractUser]:
    application, codename = PUBLISH.split(".")
    permission = Permission.objects.filter(content_type__app_label=application, codename=codename)
    may = Q(is_superuser=True) | Q(user_permissions__in=permission) | Q(groups__permissions__in=permission)
    return _staff().filter(may).distinct()
