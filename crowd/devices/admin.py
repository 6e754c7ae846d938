"""Devices and installations for administrators."""

from typing import Any

from django.contrib import admin
from django.db.models import Count, QuerySet
from django.http import HttpRequest
from django.utils import timezone

from crowd.devices.models import DeviceDescription, DeviceModel, Installation
from crowd.readonly import ReadOnlyAdmin, ReadOnlyInline


class DescriptionInline(ReadOnlyInline):
    model = DeviceDescription
    fields = ("first_seen_at", "raw")


@admin.register(DeviceModel)
class DeviceModelAdmin(ReadOnlyAdmin):
    """Models as derived from raw strings, with the strings."""

    list_display = ("name", "manufacturer", "soc", "gpu", "os", "session_count", "created_at")
    list_filter = ("os", "manufacturer")
    search_fields = ("name", "manufacturer", "slug", "soc", "gpu", "cpu")
    inlines = (DescriptionInline,)

    def get_queryset(self, request: HttpRequest) -> QuerySet[DeviceModel]:
        return super().get_queryset(request).annotate(session_count=Count("sessions"))

    @admin.display(description="sessions", ordering="session_count")
    def session_count(self, row: Any) -> int:
        return int(row.session_count)


@admin.register(Installation)
class InstallationAdmin(ReadOnlyAdmin):
    """Anonymous installations; a token can be revoked."""

    list_display = (
        "id",
        "app",
        "app_version",
        "consent_version",
        "session_count",
        "created_at",
        "revoked_at",
    )
    list_filter = ("app", "app_version", "consent_version", ("revoked_at", admin.EmptyFieldListFilter))
    search_fields = ("id",)
    exclude = ("token_sha256",)
    actions = ("revoke",)

    def get_queryset(self, request: HttpRequest) -> QuerySet[Installation]:
        return super().get_queryset(request).annotate(session_count=Count("sessions"))

    @admin.display(description="sessions", ordering="session_count")
    def session_count(self, row: Any) -> int:
        return int(row.session_count)

    @admin.action(description="Revoke the selected installations' tokens", permissions=["revoke"])
    def revoke(self, request: HttpRequest, queryset: QuerySet[Installation]) -> None:
        count = queryset.filter(revoked_at=None).update(revoked_at=timezone.now())
        self.message_user(request, f"{count} tokens revoked: those clients must enrol again")

    def has_revoke_permission(self, request: HttpRequest) -> bool:
        """Whoever may change installations may revoke their tokens; the form itself stays read-only."""
        return bool(request.user.has_perm("devices.change_installation"))
