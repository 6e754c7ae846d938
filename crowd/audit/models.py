"""The audit log: who did what to what, and when. Rows are added, never changed or deleted."""

from typing import Any

from django.core.exceptions import ValidationError
from django.db import models


class AppendOnlyError(ValidationError):
    """An attempt to change or delete an entry of the log."""

    def __init__(self) -> None:
        super().__init__("entries of the audit log cannot be changed or deleted", code="append_only")


class AuditEntryQuerySet(models.QuerySet["AuditEntry"]):
    """Refuses bulk updates and deletes."""

    def update(self, **values: Any) -> int:  # noqa: ARG002
        raise AppendOnlyError

    def delete(self) -> tuple[int, dict[str, int]]:
        raise AppendOnlyError


class AuditEntry(models.Model):
    """One action of an administrator.

    `from_state`, `to_state` and `digest` are empty if the subject has no states or no content. `front` is set
    from the review of a front on: the foreign key then protects the front from deletion.
    """

    at = models.DateTimeField(auto_now_add=True)
    actor = models.CharField(max_length=150, help_text="user name, or where the command was given")
    account = models.BigIntegerField(
        null=True, blank=True, help_text="id of the actor's account, also once it is renamed or deleted"
    )
    action = models.CharField(max_length=64)
    subject = models.CharField(
        max_length=200, help_text="a front's name, or a kind and a name, as in exploration 7"
    )
    front = models.ForeignKey(
        "fronts.FrontVersion", on_delete=models.PROTECT, null=True, blank=True, related_name="audit"
    )
    from_state = models.CharField(max_length=16, blank=True)
    to_state = models.CharField(max_length=16, blank=True)
    digest = models.CharField(max_length=64, blank=True, help_text="of a front's content at that time")
    note = models.TextField(blank=True)

    objects = AuditEntryQuerySet.as_manager()

    class Meta:
        ordering = ["-id"]
        verbose_name_plural = "audit log"
        indexes = [models.Index(fields=["subject"], name="audit_entry_subject")]

    def __str__(self) -> str:
        return f"{self.subject}: {self.action} by {self.actor}"

    def save(self, *args: Any, **kwargs: Any) -> None:
        """Store a new entry. Raises AppendOnlyError for an entry that is already stored."""
        if self.pk is not None:
            raise AppendOnlyError
        super().save(*args, **kwargs)

    def delete(self, *args: Any, **kwargs: Any) -> tuple[int, dict[str, int]]:  # noqa: ARG002
        """Raises AppendOnlyError."""
        raise AppendOnlyError
