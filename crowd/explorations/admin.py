"""Explorations in the administration: create, steer, choose points to publish. Evaluations are read-only."""

from typing import Any

from django.contrib import admin, messages
from django.contrib.admin import helpers
from django.core.exceptions import PermissionDenied, ValidationError
from django.db import transaction
from django.db.models import QuerySet
from django.forms import ModelForm
from django.http import HttpRequest, HttpResponse
from django.shortcuts import redirect
from django.urls import URLPattern, reverse

from crowd.administration.pages import PagesAdmin
from crowd.administration.readonly import JsonTables, ReadOnlyAdmin
from crowd.explorations import selectors, services, space_choice, steering
from crowd.explorations.forms import ExplorationForm, ReferenceDeviceForm, initial_values
from crowd.explorations.measuring import tokens
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from crowd.explorations.outcomes import duration, publishing
from crowd.explorations.preparing import preparation
from crowd.explorations.searching.applications import applications
from crowd.explorations.steering import STEPS
from crowd.fronts.models import FrontVersion
from wire.protocol import VALID_BELOW

CHANGE, DRAFT = "explorations.change_exploration", "fronts.submit_frontversion"
DEVICE = "explorations.change_referencedevice"
MAX_REPEATS = 20
NAME_PREFIX = "name-"
ESTIMATE = "_estimate"  # the button that only estimates the duration


@admin.register(ReferenceDevice)
class ReferenceDeviceAdmin(PagesAdmin):
    """Reference devices, and their tokens for leases over HTTP."""

    form = ReferenceDeviceForm
    list_display = (
        *("name", "elsewhere", "queue", "backend", "opencl_device", "machines", "token_issued_at", "seen_at"),
        "set_aside",
    )
    search_fields = ("name", "queue", "opencl_device")
    readonly_fields = ("token_issued_at", "seen_at")
    fields = (
        *("name", "queue", "backend", "opencl_device", "machines", "set_aside", "token_issued_at", "seen_at"),
    )

    def get_urls(self) -> list[URLPattern]:
        return [self._route("<int:key>/token/", self.token, "token"), *super().get_urls()]

    def has_change_permission(self, request: HttpRequest, obj: Any = None) -> bool:
        """A device of another server is only shown."""
        return not (obj is not None and obj.elsewhere) and super().has_change_permission(request, obj)

    def has_delete_permission(self, request: HttpRequest, obj: Any = None) -> bool:
        """A device with explorations cannot be deleted: they refer to it."""
        unused = obj is None or not obj.explorations.exists()
        return unused and super().has_delete_permission(request, obj)

    def delete_model(self, request: HttpRequest, obj: ReferenceDevice) -> None:
        """Delete a device and revoke its token."""
        with transaction.atomic():
            tokens.revoke_token(obj, _user_name(request), "the device was deleted")
            super().delete_model(request, obj)

    def delete_queryset(self, request: HttpRequest, queryset: QuerySet[ReferenceDevice]) -> None:
        with transaction.atomic():
            for device in queryset:
                self.delete_model(request, device)

    def token(self, request: HttpRequest, key: int) -> HttpResponse:
        """Issue a token and show it once, or revoke the current one."""
        device = self._get_or_deny(request, key, DEVICE)
        if device.elsewhere:
            raise PermissionDenied
        if request.method == "POST" and request.POST.get("act") == "issue":
            token = tokens.issue_token(device, _user_name(request))
            return self._render(request, "token", device, f"Token of {device}", token=token)
        if request.method == "POST":
            tokens.revoke_token(device, _user_name(request))
            self.message_user(request, f"The token of {device} is revoked", messages.SUCCESS)
        return redirect("admin:explorations_referencedevice_change", key)


@admin.register(Exploration)
class ExplorationAdmin(JsonTables, PagesAdmin):
    """Explorations. They are read-only after creation; buttons steer them and make draft fronts of points."""

    form = ExplorationForm
    list_display = (
        *("id", "application", "sequence", "reference_device", "method", "seed", "budget", "state"),
        *("pending", "running", "done", "failed", "created_at"),
    )
    list_display_links = ("id", "application")
    list_filter = ("state", "application", "reference_device", "method")
    search_fields = ("sequence", "command")
    date_hierarchy = "created_at"
    actions = ("pause", "resume", "cancel")
    fieldsets = (
        (
            "What is searched",
            {
                "fields": (
                    *("design_space", "space_file", "space_uploaded", "system", "pack", "further_packs"),
                    *("held_out_packs", "reference_device"),
                )
            },
        ),
        (
            "What for",
            {
                "fields": (
                    *("minimised", "error_quantile", "max_error_cm", "max_runtime_ms", "max_runtime_ratio"),
                    "more_limits",
                )
            },
        ),
        (
            "How",
            {
                "fields": (
                    *("method", "budget", "random_first", "more_options", "batch", "seed", "frames"),
                    "warm_start_from",
                )
            },
        ),
        ("Against noise", {"fields": ("points", "repeats", "recheck", "synchronous")}),
    )
    shown = (
        ("How far it is", ("state", "note", "created_at", "finished_at")),
        (
            "What is searched",
            (
                *("application", "space", "sequence", "sequence_sha256", "further_sequences"),
                *("held_out_sequences", "reference_device"),
            ),
        ),
        ("What for", ("objectives", "limits", "error_quantile")),
        (
            "How",
            (
                *("method", "options", "budget", "batch", "seed", "frames", "warm_start_from", "synchronous"),
                *("recheck", "points", "repeats", "command"),
            ),
        ),
    )

    def get_urls(self) -> list[URLPattern]:
        return [
            self._route("<int:key>/step/", self.step, "step"),
            self._route("<int:key>/points/", self.points_page, "points"),
            self._route("prepare/<int:front>/", self.prepare, "prepare"),
            *super().get_urls(),
        ]

    def get_queryset(self, request: HttpRequest) -> QuerySet[Exploration]:  # noqa: ARG002
        return selectors.with_counts()

    def get_fieldsets(self, request: HttpRequest, obj: Any = None) -> Any:  # noqa: ARG002
        if obj is None:
            return self.fieldsets
        return [(title, {"fields": self.as_tables(fields)}) for title, fields in self.shown]

    def get_form(self, request: HttpRequest, obj: Any = None, change: bool = False, **kwargs: Any) -> Any:
        """The form is for new explorations; existing ones are read-only."""
        if obj is None:
            kwargs["fields"] = ExplorationForm.Meta.fields
        else:
            kwargs["form"] = ModelForm
        return super().get_form(request, obj, change, **kwargs)

    def get_changeform_initial_data(self, request: HttpRequest) -> dict[str, Any]:
        """The options of exploration N for `?clone=N`; also its measurements for `?warm_start=N`."""
        for option in ("clone", "warm_start"):
            key = request.GET.get(option, "")
            earlier = Exploration.objects.filter(pk=int(key)).first() if key.isdecimal() else None
            if earlier is not None:
                warm = {"warm_start_from": earlier.pk} if option == "warm_start" else {}
                return initial_values(services.clone(earlier)) | warm
        return {}

    def has_change_permission(self, request: HttpRequest, obj: Any = None) -> bool:  # noqa: ARG002
        return False

    def has_delete_permission(self, request: HttpRequest, obj: Any = None) -> bool:  # noqa: ARG002
        return False

    def has_steer_permission(self, request: HttpRequest) -> bool:
        """Users who may change explorations can steer them, although the form is read-only."""
        return bool(request.user.has_perm(CHANGE))

    def save_model(self, request: HttpRequest, obj: Exploration, form: Any, change: bool) -> None:  # noqa: ARG002
        """Store a new exploration and send its first measurements."""
        steering.start(obj, _user_name(request))

    def add_view(self, request: HttpRequest, form_url: str = "", extra_context: Any = None) -> HttpResponse:
        if request.method == "POST" and ESTIMATE in request.POST:
            return self._estimated(request)
        context = {"show_save_and_add_another": False, "show_save_and_continue": False}
        return super().add_view(request, form_url, context | (extra_context or {}))

    def _estimated(self, request: HttpRequest) -> HttpResponse:
        """The form with the estimated duration of the exploration. Nothing is stored."""
        if not self.has_add_permission(request):
            raise PermissionDenied
        form = self.get_form(request)(request.POST, request.FILES)
        valid = form.is_valid()
        fields = helpers.AdminForm(form, list(self.get_fieldsets(request)), {}, [], model_admin=self)
        context = self.admin_site.each_context(request) | {
            "title": "Add exploration",
            "adminform": fields,
            "inline_admin_formsets": [],
            "errors": helpers.AdminErrorList(form, []),
            "media": self.media + fields.media,
            "is_popup": False,
            "to_field": None,
            "show_save_and_add_another": False,
            "show_save_and_continue": False,
        }
        if valid:
            context["estimate"] = duration.estimate(form.instance)
            context["space_size"] = space_choice.describe_size(form.space)
        return self.render_change_form(request, context, add=True)

    def response_add(self, request: HttpRequest, obj: Any, post_url_continue: Any = None) -> HttpResponse:  # noqa: ARG002
        """Show the new exploration with its buttons."""
        self.message_user(request, f"Exploration {obj.pk} is running", messages.SUCCESS)
        return redirect("admin:explorations_exploration_change", obj.pk)

    def change_view(
        self, request: HttpRequest, object_id: str, form_url: str = "", extra_context: Any = None
    ) -> HttpResponse:
        row: Exploration | None = self.get_object(request, object_id)
        may = request.user.has_perm(CHANGE)
        context = {
            "steps": steering.available_steps(row) if row is not None and may else [],
            "may_clone": self.has_add_permission(request),
            "may_choose": may,
        }
        return super().change_view(request, object_id, form_url, context | (extra_context or {}))

    @admin.action(description="Pause", permissions=["steer"])
    def pause(self, request: HttpRequest, queryset: QuerySet[Exploration]) -> None:
        self._steer_each(request, queryset, "pause")

    @admin.action(description="Resume", permissions=["steer"])
    def resume(self, request: HttpRequest, queryset: QuerySet[Exploration]) -> None:
        self._steer_each(request, queryset, "resume")

    @admin.action(description="Cancel for good", permissions=["steer"])
    def cancel(self, request: HttpRequest, queryset: QuerySet[Exploration]) -> None:
        self._steer_each(request, queryset, "cancel")

    def step(self, request: HttpRequest, key: int) -> HttpResponse:
        """Take the step in the form."""
        exploration = self._get_or_deny(request, key, CHANGE)
        name = request.POST.get("step", "")
        if name not in STEPS:
            raise PermissionDenied
        self._steer(request, exploration, name, request.POST.get("budget", ""))
        return redirect("admin:explorations_exploration_change", key)

    def prepare(self, request: HttpRequest, front: int) -> HttpResponse:
        """Prepare the front with that key, or resume or cancel its preparation, as the form says."""
        row = FrontVersion.objects.filter(pk=front).first()
        if row is None or request.method != "POST" or not request.user.has_perm(DRAFT):
            raise PermissionDenied
        act, current = request.POST.get("act", ""), preparation.latest(row)
        if act in ("resume", "cancel") and current is not None:
            self._steer(request, current, act)
            return redirect("admin:fronts_frontversion_change", front)
        try:
            begun = steering.prepare(row, _user_name(request))
        except (ValidationError, *publishing.REFUSALS) as error:
            self._show_refusal(request, error)
            return redirect("admin:fronts_frontversion_change", front)
        self.message_user(request, f"Front {begun.prepares} is being prepared", messages.SUCCESS)
        return redirect("admin:fronts_frontversion_change", begun.prepares_id)

    def points_page(self, request: HttpRequest, key: int) -> HttpResponse:
        """Choose points by naming them; measure them again, or make a draft front of them."""
        exploration = self._get_or_deny(request, key, CHANGE)
        names = {
            field.removeprefix(NAME_PREFIX): name.strip()
            for field, name in request.POST.items()
            if field.startswith(NAME_PREFIX) and isinstance(name, str) and name.strip()
        }
        if request.method == "POST":
            try:
                if request.POST.get("act") == "draft":
                    return self._draft(request, exploration, names)
                return self._measure_again(request, exploration, names)
            except (ValidationError, *publishing.REFUSALS) as error:
                self._show_refusal(request, error)
        shown = self._shown_application(request, exploration)
        rows, reason = publishing.candidates(exploration, shown)
        return self._render(
            request,
            "points",
            exploration,
            f"Points of exploration {exploration.pk}",
            candidates=[(row, names.get(row.key, "") if names else row.name) for row in rows],
            reason=reason,
            applications=applications(exploration),
            shown=shown,
            unfinished=services.unfinished_evaluations(exploration).count(),
            repeats=max(exploration.repeats, publishing.LEAST_REPEATS),
            most_repeats=MAX_REPEATS,
            least_repeats=publishing.LEAST_REPEATS,
            limit=VALID_BELOW,
            may_draft=request.user.has_perm(DRAFT),
        )

    def _measure_again(
        self, request: HttpRequest, exploration: Exploration, names: dict[str, str]
    ) -> HttpResponse:
        times = request.POST.get("times", "")
        if not times.isdecimal() or not 1 <= int(times) <= MAX_REPEATS:
            raise ValidationError(f"{times!r} times: give a number from 1 to {MAX_REPEATS}")
        rows = steering.measure_again(exploration, names, int(times), _user_name(request))
        self.message_user(request, f"New measurements: {len(rows)}", messages.SUCCESS)
        return redirect(request.get_full_path())

    @staticmethod
    def _shown_application(request: HttpRequest, exploration: Exploration) -> str:
        """The application whose points are asked for, by default the first of `exploration`."""
        possible = applications(exploration)
        asked = request.GET.get("application", possible[0])
        return asked if asked in possible else possible[0]

    def _draft(self, request: HttpRequest, exploration: Exploration, names: dict[str, str]) -> HttpResponse:
        if not request.user.has_perm(DRAFT):
            raise PermissionDenied
        front = publishing.create_draft(
            exploration, names, _user_name(request), self._shown_application(request, exploration)
        )
        self.message_user(request, f"Front {front.slug} is a draft", messages.SUCCESS)
        return redirect(reverse("admin:fronts_frontversion_change", args=[front.pk]))

    def _steer_each(self, request: HttpRequest, queryset: QuerySet[Exploration], name: str) -> None:
        for exploration in queryset:
            self._steer(request, exploration, name)

    def _steer(self, request: HttpRequest, exploration: Exploration, name: str, budget: str = "") -> None:
        try:
            done = steering.take_step(name, exploration, _user_name(request), budget)
        except ValidationError as error:
            self._show_refusal(request, error)
        else:
            self.message_user(request, f"Exploration {exploration.pk}: {done}", messages.SUCCESS)

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
        *("error", "worker", "finished_at"),
    )
    list_filter = ("state", "phase", "exploration")
    search_fields = ("label", "error", "configuration")
    list_select_related = ("exploration",)

    @admin.display(description="ms a frame")
    def milliseconds(self, row: Evaluation) -> str:
        return f"{1e3 * row.objectives['runtime']:.2f}" if row.objectives else ""

    @admin.display(description="max error, mm")
    def millimetres(self, row: Evaluation) -> str:
        if not row.objectives:
            return ""
        return f"{'at least ' if 'ate_max' in row.censored else ''}{1e3 * row.objectives['ate_max']:.1f}"


def _user_name(request: HttpRequest) -> str:
    return str(request.user.get_username())
