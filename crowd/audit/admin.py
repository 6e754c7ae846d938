"""The audit log for administrators, and accounts whose names differ in more than case."""

from typing import Any

from django.contrib import admin
from django.contrib.auth.admin import UserAdmin
from django.contrib.auth.forms import AdminUserCreationForm, UserChangeForm
from django.contrib.auth.models import User

from crowd.administration.readonly import ReadOnlyAdmin
from crowd.audit import accounts
from crowd.audit.models import AuditEntry


class UniqueName:
    """A form that refuses the name of another account in any case."""

    def clean_username(self: Any) -> str:
        name: str = self.cleaned_data["username"]
        if name != self.initial.get("username"):
            accounts.check_name(name, self.instance.pk)
        return name


class AccountForm(UniqueName, UserChangeForm):  # type: ignore[type-arg]  # not generic at run time
    """Changes an account."""


class NewAccountForm(UniqueName, AdminUserCreationForm):  # type: ignore[type-arg]  # not generic at run time
    """Creates an account."""


admin.site.unregister(User)


@admin.register(User)
class AccountAdmin(UserAdmin):  # type: ignore[type-arg]  # not generic at run time
    """Django's accounts with these forms."""

    form, add_form = AccountForm, NewAccountForm


@admin.register(AuditEntry)
class AuditEntryAdmin(ReadOnlyAdmin):
    """The audit log, read-only."""

    list_display = (
        "at",
        "actor",
        "account",
        "action",
        "subject",
        "from_state",
        "to_state",
        "short_digest",
        "note",
    )
    list_filter = ("action", "actor")
    search_fields = ("subject", "actor", "digest", "note")
    date_hierarchy = "at"

    @admin.display(description="digest")
    def short_digest(self, row: AuditEntry) -> str:
        return row.digest[:12]
