"""The administration of probe requests; maps, assignments and recommendations are read-only."""

from typing import Any

from django.contrib import admin
from django.db.models import QuerySet
from django.http import HttpRequest

from crowd.administration.readonly import ReadOnlyAdmin
from crowd.fronts.models import Configuration, FrontVersion
from crowd.predictions.models import DeviceMap, ProbeAssignment, ProbeRequest, Recommendation


@admin.register(DeviceMap)
class DeviceMapAdmin(ReadOnlyAdmin):
    list_display = ("__str__", "rung", "devices", "sessions", "made_at")
    fields = (
        "front", "backend", "processor_class", "rung", "scale", "errors", "devices", "sessions",
        "made_at",
    )  # fmt: skip


@admin.register(ProbeRequest)
class ProbeRequestAdmin(admin.ModelAdmin):  # type: ignore[type-arg]  # not generic at run time
    list_display = ("configuration", "chip", "sessions", "reason", "active", "created_at")
    list_filter = ("active",)

    def get_queryset(self, request: HttpRequest) -> QuerySet[ProbeRequest]:
        rows = super().get_queryset(request).select_related("configuration__front")
        return rows.defer("configuration__front__document", "configuration__front__sequence")

    def formfield_for_foreignkey(self, db_field: Any, request: Any, **kwargs: Any) -> Any:
        """Offer only configurations of published fronts."""
        if db_field.name == "configuration":
            published = Configuration.objects.filter(front__state=FrontVersion.State.PUBLISHED)
            kwargs["queryset"] = published.select_related("front").defer("front__document", "front__sequence")
        return super().formfield_for_foreignkey(db_field, request, **kwargs)


@admin.register(ProbeAssignment)
class ProbeAssignmentAdmin(ReadOnlyAdmin):
    list_display = ("configuration", "processor", "backend", "why", "assigned_at")
    list_select_related = ("configuration__front",)


@admin.register(Recommendation)
class RecommendationAdmin(ReadOnlyAdmin):
    list_display = ("device", "front", "backend", "configuration", "rung", "log_ratio", "made_at")
    list_select_related = ("device", "front", "configuration__front")
