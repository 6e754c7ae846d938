"""The audit log for administrators."""

from django.contrib import admin

from crowd.administration.readonly import ReadOnlyAdmin
from crowd.audit.models import AuditEntry


@admin.register(AuditEntry)
class AuditEntryAdmin(ReadOnlyAdmin):
    """The audit log, read-only."""

    list_display = ("at", "actor", "action", "subject", "from_state", "to_state", "short_digest", "note")
    list_filter = ("action", "actor")
    search_fields = ("subject", "actor", "digest", "note")
    date_hierarchy = "at"

    @admin.display(description="digest")
    def short_digest(self, row: AuditEntry) -> str:
        return row.digest[:12]
