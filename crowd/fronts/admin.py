"""Fronts for administrators: drafts can be published, published ones retired, nothing edited."""

from typing import Any

from django.contrib import admin, messages
from django.db.models import Count, QuerySet
from django.http import HttpRequest

from crowd.fronts import services
from crowd.fronts.models import Configuration, FrontVersion
from crowd.readonly import ReadOnlyAdmin, ReadOnlyInline


class ConfigurationInline(ReadOnlyInline):
    model = Configuration
    fields = ("position", "name", "parameters", "predicted")


@admin.register(FrontVersion)
class FrontVersionAdmin(ReadOnlyAdmin):
    """Read-only: fronts come from files and explorations, and what is published stays."""

    list_display = ("slug", "application", "state", "points", "published_at", "short_digest")
    list_filter = ("application", "state")
    search_fields = ("slug", "digest")
    date_hierarchy = "published_at"
    inlines = (ConfigurationInline,)
    actions = ("publish", "retire")

    def get_queryset(self, request: HttpRequest) -> QuerySet[FrontVersion]:
        return super().get_queryset(request).annotate(points=Count("configurations"))

    @admin.display(ordering="points")
    def points(self, row: Any) -> int:
        return int(row.points)

    @admin.display(description="digest")
    def short_digest(self, row: FrontVersion) -> str:
        return row.digest[:12]

    @admin.action(description="Publish the selected drafts", permissions=["publish"])
    def publish(self, request: HttpRequest, queryset: QuerySet[FrontVersion]) -> None:
        for front in queryset.filter(state=FrontVersion.State.DRAFT):
            services.publish(front)
            self.message_user(request, f"{front.slug} is published: clients measure it now", messages.SUCCESS)

    @admin.action(description="Retire the selected fronts", permissions=["publish"])
    def retire(self, request: HttpRequest, queryset: QuerySet[FrontVersion]) -> None:
        for front in queryset.filter(state=FrontVersion.State.PUBLISHED):
            services.retire(front)
            self.message_user(
                request, f"{front.slug} is retired: no client is told of it now", messages.SUCCESS
            )

    def has_publish_permission(self, request: HttpRequest) -> bool:
        """Whoever may change fronts may publish them; the form itself stays read-only."""
        return bool(request.user.has_perm("fronts.change_frontversion"))
