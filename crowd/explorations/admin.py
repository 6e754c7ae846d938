"""Explorations for administrators: create, watch, stop, publish. Measurements are only read."""

from typing import Any

from django.contrib import admin, messages
from django.db.models import QuerySet
from django.forms import ModelForm
from django.http import HttpRequest

from crowd.explorations import publishing, selectors, services, tasks
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from crowd.fronts.contents import InvalidFrontError
from crowd.fronts.sequences import SequenceError
from crowd.fronts.services import FrontConflictError
from crowd.readonly import ReadOnlyAdmin

REFUSALS = (publishing.NothingToPublishError, InvalidFrontError, SequenceError, FrontConflictError)


@admin.register(ReferenceDevice)
class ReferenceDeviceAdmin(admin.ModelAdmin):
    list_display = ("name", "queue", "opencl_device")
    search_fields = ("name", "queue", "opencl_device")


class ExplorationForm(ModelForm):
    """Says what is wrong with a new exploration before it is stored."""

    def clean(self) -> dict[str, Any] | None:
        cleaned = super().clean()
        if not self.errors and cleaned is not None:
            services.check(Exploration(**cleaned))
        return cleaned


@admin.register(Exploration)
class ExplorationAdmin(admin.ModelAdmin):
    """What was created stays as it is; it can be stopped, and its front published."""

    form = ExplorationForm
    list_display = (
        *("id", "application", "sequence", "reference_device", "method", "seed", "budget", "state"),
        *("pending", "running", "done", "failed", "created_at"),
    )
    list_filter = ("state", "application", "reference_device", "method")
    search_fields = ("sequence", "command")
    date_hierarchy = "created_at"
    actions = ("stop", "publish_front")
    fields = (
        *("application", "space", "sequence", "sequence_sha256", "reference_device", "objectives", "limits"),
        *("method", "seed", "budget", "batch", "points", "repeats"),
    )

    def get_queryset(self, request: HttpRequest) -> QuerySet[Exploration]:  # noqa: ARG002
        return selectors.counted()

    def has_change_permission(self, request: HttpRequest, obj: Any = None) -> bool:  # noqa: ARG002
        return False

    def has_delete_permission(self, request: HttpRequest, obj: Any = None) -> bool:  # noqa: ARG002
        return False

    def has_steer_permission(self, request: HttpRequest) -> bool:
        """Whoever may change explorations may stop and publish them; their form stays read-only."""
        return bool(request.user.has_perm("explorations.change_exploration"))

    def save_model(self, request: HttpRequest, obj: Exploration, form: Any, change: bool) -> None:  # noqa: ARG002
        """Store a new exploration and send its first measurements."""
        tasks.dispatch(services.create(obj))

    @admin.action(description="Stop the selected explorations", permissions=["steer"])
    def stop(self, request: HttpRequest, queryset: QuerySet[Exploration]) -> None:
        for exploration in queryset:
            services.cancel(exploration)
            self.message_user(request, f"Stopped {exploration}: it measures nothing more", messages.SUCCESS)

    @admin.action(description="Publish front", permissions=["steer"])
    def publish_front(self, request: HttpRequest, queryset: QuerySet[Exploration]) -> None:
        for exploration in queryset:
            try:
                front = publishing.publish(exploration)
            except REFUSALS as error:
                self.message_user(request, f"Not published, {exploration}: {error}", messages.ERROR)
            else:
                self.message_user(
                    request, f"Published {front.slug}: clients measure it now", messages.SUCCESS
                )

    @admin.display(ordering="pending")
    def pending(self, row: Any) -> int:
        return int(row.pending)

    @admin.display(ordering="running")
    def running(self, row: Any) -> int:
        return int(row.running)

    @admin.display(ordering="done")
    def done(self, row: Any) -> int:
        return int(row.done)

    @admin.display(ordering="failed")
    def failed(self, row: Any) -> int:
        return int(row.failed)


@admin.register(Evaluation)
class EvaluationAdmin(ReadOnlyAdmin):
    list_display = (
        *("exploration", "number", "phase", "label", "state", "attempt", "milliseconds", "millimetres"),
        *("error", "finished_at"),
    )
    list_filter = ("state", "phase", "exploration")
    search_fields = ("label", "error", "configuration")
    list_select_related = ("exploration",)

    @admin.display(description="ms a frame")
    def milliseconds(self, row: Evaluation) -> str:
        return f"{1e3 * row.objectives['runtime']:.2f}" if row.objectives else ""

    @admin.display(description="max error, mm")
    def millimetres(self, row: Evaluation) -> str:
        return f"{1e3 * row.objectives['ate_max']:.1f}" if row.objectives else ""
