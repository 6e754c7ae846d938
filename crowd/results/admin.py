"""Measurements and figures in the administration, read-only.

Sessions and runs can be quarantined or released. Such a decision is a separate, logged row.
"""

from functools import partial
from typing import Any

from django.contrib import admin, messages
from django.core.exceptions import PermissionDenied, ValidationError
from django.db.models import Q, QuerySet
from django.http import HttpRequest, HttpResponse
from django.shortcuts import redirect
from django.urls import URLPattern, path, reverse
from django.utils.html import format_html
from django.utils.safestring import SafeString

from crowd.administration.json_tables import as_html
from crowd.administration.readonly import ReadOnlyAdmin, ReadOnlyInline
from crowd.results import moderation
from crowd.results.erasure_page import ERASE, erase_measurements
from crowd.results.figures import statistics
from crowd.results.intake import packing
from crowd.results.models import (
    Decision,
    DeviceSpeedup,
    Export,
    ExportFile,
    MeasurementSession,
    Run,
    SessionSummary,
    Submission,
    Tombstone,
)
from crowd.results.opendata.releases import ReleaseError, make_release

DECIDE = "results.add_decision"
RELEASE = "results.release_export"


class RunInline(ReadOnlyInline):
    model = Run
    fields = ("order", "configuration", "repeat", "status", "mean_us", "ate_max", "state", "reason")


class SummaryInline(ReadOnlyInline):
    model = SessionSummary
    fk_name = "session"
    fields = ("configuration", "baseline", "log_ratio", "clock", "pairs", "drift", "state", "reason")


class ModeratedAdmin(ReadOnlyAdmin):
    """Rows that users with the permission can quarantine or release, with a reason."""

    change_form_template = "admin/results/moderated.html"

    def get_urls(self) -> list[URLPattern]:
        decide = self.admin_site.admin_view(self.decide)
        return [path("<int:key>/decide/", decide, name=self._name("decide")), *super().get_urls()]

    def change_view(
        self, request: HttpRequest, object_id: str, form_url: str = "", extra_context: Any = None
    ) -> HttpResponse:
        row = self.get_object(request, object_id)
        context = {} if row is None else self._moderation(request, row)
        return super().change_view(request, object_id, form_url, context | (extra_context or {}))

    def decide(self, request: HttpRequest, key: int) -> HttpResponse:
        """Store the decision of the form; 403 for users without the permission."""
        row = self.get_object(request, str(key))
        if row is None or request.method != "POST" or not request.user.has_perm(DECIDE):
            raise PermissionDenied
        action, reason = (request.POST.get(name, "") for name in ("action", "reason"))
        try:
            decision = moderation.decide(action, request.user.get_username(), reason, **_subject(row))
        except ValidationError as error:
            self.message_user(request, f"Nothing was done: {'; '.join(error.messages)}", messages.ERROR)
        else:
            self.message_user(request, f"Logged: {decision}", messages.SUCCESS)
        return redirect(f"admin:{self._name('change')}", key)

    def _moderation(self, request: HttpRequest, row: Any) -> dict[str, Any]:
        subject = _subject(row)
        log = Decision.objects.filter(session=subject["session"]).select_related("run")
        if "run" in subject:
            log = log.filter(Q(run=None) | Q(run=subject["run"]))
        return {
            "may_decide": request.user.has_perm(DECIDE),
            "decide": reverse(f"admin:{self._name('decide')}", args=[row.pk]),
            "log": log,
        }

    def _name(self, page: str) -> str:
        return f"{self.opts.app_label}_{self.opts.model_name}_{page}"


def _subject(row: Any) -> dict[str, Any]:
    """The session, and perhaps the run, of a decision on `row`."""
    return {"session": row.session, "run": row} if isinstance(row, Run) else {"session": row}


@admin.register(Submission)
class SubmissionAdmin(ReadOnlyAdmin):
    """Accepted requests with their responses."""

    json_texts = ("answer",)

    list_display = ("id", "installation", "app_version", "schema_version", "received_at")
    list_filter = ("app_version", "consent_version")
    list_select_related = ("installation",)
    search_fields = ("id", "idempotency_key", "installation__id")
    date_hierarchy = "received_at"


@admin.register(MeasurementSession)
class MeasurementSessionAdmin(ModeratedAdmin):
    """Sessions with their runs and summaries."""

    list_display = ("uuid", "device", "front", "backend", "processor", "started_at", "summary_algorithm")
    list_filter = (
        "front",
        "backend",
        "device__os",
        ("summary_algorithm", admin.EmptyFieldListFilter),
    )
    list_select_related = ("device", "front")
    search_fields = ("uuid", "installation__id", "device__name", "device__slug", "processor")
    date_hierarchy = "received_at"
    readonly_fields = ("device_strings",)
    inlines = (SummaryInline, RunInline)

    @admin.display(description="description sent by the device")
    def device_strings(self, row: MeasurementSession) -> SafeString:
        return as_html(row.description.raw)


@admin.register(Run)
class RunAdmin(ModeratedAdmin):
    """Runs with their states. The public page of a run shows its frames."""

    list_display = (
        "uuid", "device", "configuration", "repeat", "status", "mean_ms", "largest_error", "state", "reason",
        "page",
    )  # fmt: skip
    list_filter = ("state", "reason", "status", "configuration__front", "session__backend")
    list_select_related = ("configuration__front", "session__device")
    search_fields = ("uuid", "session__uuid", "session__device__name", "configuration__name")
    readonly_fields = ("times", "page")

    @admin.display(ordering="session__device")
    def device(self, row: Run) -> str:
        return str(row.session.device)

    @admin.display(description="mean (ms)", ordering="mean_us")
    def mean_ms(self, row: Run) -> str:
        return "" if row.mean_us is None else f"{row.mean_us / 1000:.2f}"

    @admin.display(description="max ATE (cm)", ordering="ate_max")
    def largest_error(self, row: Run) -> str:
        return "" if row.ate_max is None else f"{row.ate_max * 100:.2f}"

    @admin.display(description="times over all frames")
    def times(self, row: Run) -> SafeString:
        """Times of a frame and of its stages."""
        stored = packing.decompress(row.frames.content)
        stages = packing.unpack_stages(stored.stages, stored.stages_us)
        series = {"frame": packing.unpack(stored.frame_us)} | stages
        return as_html(
            {
                name: {
                    "mean (ms)": float(times.mean()) / 1000,
                    "least (ms)": float(times.min()) / 1000,
                    "most (ms)": float(times.max()) / 1000,
                    "frames": len(times),
                }
                for name, times in series.items()
                if len(times)
            }
        )

    @admin.display(description="frames")
    def page(self, row: Run) -> str:
        return format_html('<a href="{}">each frame</a>', reverse("dashboard:run", args=[row.uuid]))


@admin.register(DeviceSpeedup)
class DeviceSpeedupAdmin(ReadOnlyAdmin):
    """The published figures."""

    list_display = (
        "device", "configuration", "baseline", "times", "low", "high", "sessions", "installations", "backend",
        "processor", "state", "algorithm", "computed_at",
    )  # fmt: skip
    list_filter = ("front", "configuration__name", "backend", "state", "device__os")
    list_select_related = ("device", "configuration__front", "baseline__front")
    search_fields = ("device__name", "device__slug", "processor")

    @admin.display(description="speedup", ordering="speedup")
    def times(self, row: DeviceSpeedup) -> str:
        return f"{row.speedup:.2f}"


@admin.register(SessionSummary)
class SessionSummaryAdmin(ReadOnlyAdmin):
    """The speedups of sessions, with the rules that set their states."""

    list_display = (
        "session",
        "configuration",
        "speedup",
        "clock",
        "pairs",
        "drift",
        "ate_max",
        "state",
        "reason",
    )
    list_filter = ("state", "reason", "configuration__front", "algorithm")
    list_select_related = ("session", "configuration__front")
    search_fields = ("session__uuid", "session__device__name")

    @admin.display(ordering="log_ratio")
    def speedup(self, row: SessionSummary) -> str:
        return "" if row.log_ratio is None else f"{statistics.ratio(row.log_ratio):.2f}"


@admin.register(Decision)
class DecisionAdmin(ReadOnlyAdmin):
    """Decisions on sessions and runs, with their reasons."""

    list_display = ("at", "actor", "action", "session", "run", "reason")
    list_filter = ("action", "actor")
    list_select_related = ("session", "run")
    search_fields = ("session__uuid", "run__uuid", "actor", "reason")
    date_hierarchy = "at"


class ExportFileInline(ReadOnlyInline):
    model = ExportFile
    fields = readonly_fields = ("name", "rows", "bytes", "stale", "sha256")
    show_change_link = False

    def rows(self, row: ExportFile) -> int | None:
        return row.stored.rows

    def bytes(self, row: ExportFile) -> int:
        return row.stored.bytes

    @admin.display(boolean=True)
    def stale(self, row: ExportFile) -> bool:
        return row.stored.stale

    def sha256(self, row: ExportFile) -> str:
        return row.stored.sha256


@admin.register(Export)
class ExportAdmin(ReadOnlyAdmin):
    """Exports of the open data with their files. Some of them stay as releases."""

    list_display = ("name", "started_at", "published_at", "release", "removed_at")
    list_filter = ("release",)
    date_hierarchy = "started_at"
    inlines = (ExportFileInline,)
    actions = ("make_releases",)

    def has_release_permission(self, request: HttpRequest) -> bool:
        """Whether the user may make an export a release."""
        return bool(request.user.has_perm(RELEASE))

    @admin.action(description="Make it a release, which stays and can be cited", permissions=["release"])
    def make_releases(self, request: HttpRequest, queryset: QuerySet[Export]) -> None:
        for export in queryset:
            try:
                make_release(export, request.user.get_username())
            except ReleaseError as error:
                self.message_user(request, str(error), messages.ERROR)
            else:
                self.message_user(request, f"{export.name} is a release now: /data/{export.name}/")


@admin.register(Tombstone)
class TombstoneAdmin(ReadOnlyAdmin):
    """Records of erasures, and the page that erases measurements."""

    list_display = ("id", "kind", "single", "erased_at")
    list_filter = ("kind", "single")
    date_hierarchy = "erased_at"

    def get_urls(self) -> list[URLPattern]:
        page = self.admin_site.admin_view(partial(erase_measurements, site=self.admin_site))
        return [path("erase/", page, name="results_erase_measurements"), *super().get_urls()]

    def changelist_view(self, request: HttpRequest, extra_context: Any = None) -> HttpResponse:
        context = {"may_erase": request.user.has_perm(ERASE)}
        return super().changelist_view(request, context | (extra_context or {}))
