"""Admin pages of fronts: drafts, reviews, publications. Content comes from files and explorations."""

import json
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from django import forms
from django.contrib import admin, messages
from django.core.exceptions import PermissionDenied, ValidationError
from django.db.models import Case, Count, Q, QuerySet, When
from django.http import HttpRequest, HttpResponse
from django.shortcuts import redirect
from django.template.response import TemplateResponse
from django.urls import URLPattern, path, reverse
from django.utils.safestring import SafeString
from msgspec import structs, to_builtins

from crowd.administration.json_tables import as_html
from crowd.administration.readonly import ReadOnlyAdmin, ReadOnlyInline
from crowd.audit.models import AuditEntry
from crowd.fronts import intake_policy, manifests, selectors
from crowd.fronts.content import front_file, plans
from crowd.fronts.content.difference import difference
from crowd.fronts.models import Configuration, FrontVersion, IntakePolicy
from crowd.fronts.publishing import second_person, services
from crowd.fronts.publishing.preview import Preview, preview
from crowd.fronts.publishing.steps import PUBLISH, STEPS, SUBMIT, Step
from wire.front import Front, Point, SequenceResult


class ConfigurationInline(ReadOnlyInline):
    model = Configuration
    fields = ("position", "name", "probe", "skipped")
    show_change_link = False


class ImportForm(forms.Form):
    """Upload of a front file, as `manage.py front export` writes it."""

    file = forms.FileField(
        help_text="fixtures/fronts/kfusion-1.json is one; docs/operate/publishing.md describes every member"
    )


@admin.register(IntakePolicy)
class IntakePolicyAdmin(admin.ModelAdmin):  # type: ignore[type-arg]  # not generic at run time
    """The kill switch for submissions.

    It takes effect with the next request; the history shows who changed it.
    """

    fields = ("accepting", "message", "minimum_app_version", "changed_at")
    readonly_fields = ("changed_at",)

    def has_add_permission(self, request: HttpRequest) -> bool:
        return super().has_add_permission(request) and not IntakePolicy.objects.exists()

    def changelist_view(self, request: HttpRequest, extra_context: Any = None) -> HttpResponse:  # noqa: ARG002
        row = IntakePolicy.objects.first()
        if row is None:
            return redirect("admin:fronts_intakepolicy_add")
        return redirect("admin:fronts_intakepolicy_change", row.pk)


@admin.register(FrontVersion)
class FrontVersionAdmin(ReadOnlyAdmin):
    """Fronts are not edited here. Each step is a button, shown to users with its permission."""

    list_display = (
        *("slug", "application", "state", "measured_now", "points", "created_at", "published_at"),
        "short_digest",
    )
    list_filter = ("application", "state")
    search_fields = ("slug", "digest")
    date_hierarchy = "created_at"
    ordering = ("-created_at",)
    inlines = (ConfigurationInline,)
    actions = ("publish", "retire")
    readonly_fields = (
        "bands",
        "parameters",
        "predictions",
        "errors",
        "held_out_errors",
        "protocol",
        "provenance",
    )
    fieldsets = (
        (
            "Version",
            {
                "fields": (
                    *("slug", "application", "version", "state", "digest", "created_at", "published_at"),
                    "retired_at",
                )
            },
        ),
        ("Configurations", {"fields": readonly_fields[:5]}),
        ("How clients measure", {"fields": ("protocol", "sequence")}),
        ("Where it comes from", {"fields": ("provenance",)}),
    )

    def get_urls(self) -> list[URLPattern]:
        def page(route: str, view: Callable[..., HttpResponse], name: str) -> URLPattern:
            return path(route, self.admin_site.admin_view(view), name=f"fronts_frontversion_{name}")

        return [
            page("import/", self.import_page, "import"),
            page("<int:key>/step/", self.step, "step"),
            page("<int:key>/manifest/", self.manifest_page, "manifest"),
            page("<int:key>/manifest.json", self.manifest, "manifest_json"),
            page("<int:key>/compare/", self.compare_page, "compare"),
            page("<int:key>/export/", self.export, "export"),
            *super().get_urls(),
        ]

    def get_queryset(self, request: HttpRequest) -> QuerySet[FrontVersion]:
        rows: QuerySet[FrontVersion] = super().get_queryset(request)
        return rows.annotate(
            points=Count("configurations", filter=Q(configurations__probe=False)),
            measured_now=Case(When(slug__in=selectors.measured_now().values(), then=True), default=False),
        )

    def changelist_view(self, request: HttpRequest, extra_context: Any = None) -> HttpResponse:
        context = {"may_import": request.user.has_perm(SUBMIT), "offered": second_person.offered()}
        return super().changelist_view(request, context | (extra_context or {}))

    def change_view(
        self, request: HttpRequest, object_id: str, form_url: str = "", extra_context: Any = None
    ) -> HttpResponse:
        front = self.get_object(request, object_id)
        context = {} if front is None else {"steps": _offered(request, front), "log": _log(front)}
        return super().change_view(request, object_id, form_url, context | (extra_context or {}))

    @admin.display(ordering="points")
    def points(self, row: Any) -> int:
        return int(row.points)

    @admin.display(boolean=True)
    def measured_now(self, row: Any) -> bool:
        return bool(row.measured_now)

    @admin.display(description="digest")
    def short_digest(self, row: FrontVersion) -> str:
        return row.digest[:12]

    @admin.display(description="distance from the reference trajectory that is allowed (m)")
    def bands(self, row: FrontVersion) -> SafeString:
        return _by_name(row, lambda point: {} if point.band is None else {"band": point.band})

    @admin.display
    def parameters(self, row: FrontVersion) -> SafeString:
        return _by_name(row, lambda point: point.parameters)

    @admin.display(description="predictions (s, m)")
    def predictions(self, row: FrontVersion) -> SafeString:
        return _by_name(row, lambda point: to_builtins(point.predicted))

    @admin.display(description="errors on the sequences learned on (m)")
    def errors(self, row: FrontVersion) -> SafeString:
        return _by_name(row, lambda point: _by_sequence(point.learned_on))

    @admin.display(description="errors on held-out sequences (m)")
    def held_out_errors(self, row: FrontVersion) -> SafeString:
        return _by_name(row, lambda point: _by_sequence(point.held_out))

    @admin.display
    def protocol(self, row: FrontVersion) -> SafeString:
        return as_html(to_builtins(row.content.protocol))

    @admin.display
    def provenance(self, row: FrontVersion) -> SafeString:
        return as_html(row.content.provenance)

    @admin.action(description="Publish the selected fronts", permissions=["publish"])
    def publish(self, request: HttpRequest, queryset: QuerySet[FrontVersion]) -> HttpResponse | None:
        """Publish fronts in review after a confirmation; others are refused with a message."""
        step, fronts = STEPS["publish"], list(queryset)
        ready = [front for front in fronts if front.state in step.states]
        shown = [preview(selectors.front_in_any_state(front.pk)) for front in ready]
        if ready and not self._confirmed(request, shown):
            chosen = [("_selected_action", front.pk) for front in fronts]
            return self._confirmation(request, shown, step, [("action", "publish"), *chosen])
        for front in fronts:
            self._take(request, front, step)
        return None

    @admin.action(description="Retire the selected fronts", permissions=["publish"])
    def retire(self, request: HttpRequest, queryset: QuerySet[FrontVersion]) -> None:
        for front in queryset:
            self._take(request, front, STEPS["retire"])

    def has_publish_permission(self, request: HttpRequest) -> bool:
        return bool(request.user.has_perm(PUBLISH))

    def step(self, request: HttpRequest, key: int) -> HttpResponse:
        """Take the step that the form names; a publication asks for confirmation. 403 without permission."""
        front, step = self._get_or_deny(request, key), STEPS.get(request.POST.get("step", ""))
        if step is None or not request.user.has_perm(step.permission):
            raise PermissionDenied
        if step.publishes and front.state in step.states:
            shown = [preview(_published_by(step, selectors.front_in_any_state(key)))]
            if not self._confirmed(request, shown):
                return self._confirmation(request, shown, step, [("step", step.name)], front)
        taken = self._take(request, front, step)
        if taken is None:
            return redirect("admin:fronts_frontversion_changelist")
        return redirect("admin:fronts_frontversion_change", taken.pk)

    def manifest_page(self, request: HttpRequest, key: int) -> HttpResponse:
        """Shows the manifest that clients would read, with a link to its JSON."""
        front = self._get_or_deny(request, key)
        content = selectors.front_in_any_state(key)
        manifest = manifests.content(content, intake_policy.current())
        return self._render(
            request,
            "manifest",
            front,
            f"What clients read of {front.slug}",
            manifest=as_html(json.loads(manifest)),
            current=selectors.measured_now().get(front.application),
            outdated=plans.outdated(content),
            bytes=len(manifest),
            etag=manifests.etag(manifest),
        )

    def manifest(self, request: HttpRequest, key: int) -> HttpResponse:
        """The manifest as JSON."""
        self._get_or_deny(request, key)
        manifest = manifests.content(selectors.front_in_any_state(key), intake_policy.current())
        return HttpResponse(manifest, content_type="application/json")

    def compare_page(self, request: HttpRequest, key: int) -> HttpResponse:
        """Compares this version with another one, by default the one that clients measure."""
        front = self._get_or_deny(request, key)
        others = FrontVersion.objects.filter(application=front.application).exclude(pk=key)
        wanted = request.GET.get("with") or getattr(selectors.current(front.application), "slug", "")
        other = others.filter(slug=wanted).first() or others.order_by("-created_at").first()
        changes = other and difference(
            selectors.front_in_any_state(other.pk), selectors.front_in_any_state(key)
        )
        title = f"{front.slug} against {other.slug}" if other else f"{front.slug} is the only version"
        return self._render(request, "compare", front, title, difference=changes, others=others)

    def export(self, request: HttpRequest, key: int) -> HttpResponse:
        """The front as a file that can be imported."""
        front = self._get_or_deny(request, key)
        text = front_file.text(selectors.content(selectors.front_in_any_state(key)))
        name = f'attachment; filename="{front.slug}.json"'
        return HttpResponse(text, content_type="application/json", headers={"Content-Disposition": name})

    def import_page(self, request: HttpRequest) -> HttpResponse:
        """Makes a draft from a file; an invalid file is refused with the reason."""
        if not request.user.has_perm(SUBMIT):
            raise PermissionDenied
        form = ImportForm(request.POST or None, request.FILES or None)
        if request.method == "POST" and form.is_valid():
            file = form.cleaned_data["file"]
            try:
                document = front_file.parse(file.read(front_file.LARGEST_FILE_BYTES + 1))
                front = services.create_draft(document, _name(request), f"from the file {file.name}")
            except services.REFUSALS as error:
                form.add_error("file", str(error))
            else:
                self.message_user(request, f"Front {front.slug} is a draft", messages.SUCCESS)
                return redirect("admin:fronts_frontversion_change", front.pk)
        return self._render(request, "import", None, "Draft from a file", form=form)

    def _get_or_deny(self, request: HttpRequest, key: int) -> FrontVersion:
        """The front with `key`. Raises PermissionDenied, also if there is none."""
        front: FrontVersion | None = self.get_object(request, str(key))
        if front is None or not self.has_view_permission(request, front):
            raise PermissionDenied
        return front

    def _confirmed(self, request: HttpRequest, shown: list[Preview]) -> bool:
        """Whether the form confirms exactly the previews `shown`."""
        confirmed = request.POST.getlist("confirmed")
        if {one.token for one in shown} <= set(confirmed):
            return True
        if confirmed:
            text = "The fronts changed since you looked at them: look again."
            self.message_user(request, text, messages.WARNING)
        return False

    def _confirmation(
        self,
        request: HttpRequest,
        shown: list[Preview],
        step: Step,
        fields: list[tuple[str, Any]],
        front: FrontVersion | None = None,
    ) -> HttpResponse:
        """The page that shows what a publication changes.

        Its form sends `fields` again with the confirmation.
        """
        title = f"Publish {', '.join(one.new.slug for one in shown)}?"
        note = request.POST.get("note", "") if step.notes else None
        return self._render(request, "publish", front, title, previews=shown, fields=fields, note=note)

    def _take(self, request: HttpRequest, front: FrontVersion, step: Step) -> FrontVersion | None:
        """Take `step` and return the resulting front. A refusal is shown as a message and changes nothing."""
        note = {"note": request.POST["note"]} if request.POST.get("note") and step.notes else {}
        try:
            taken = step.take(front, by=_name(request), **note)
        except (ValidationError, *services.REFUSALS) as error:
            text = "; ".join(getattr(error, "messages", [str(error)]))
            self.message_user(request, f"Nothing was done: {text}", messages.ERROR)
            return front
        after = taken or front
        done = step.done.format(after, state=after.get_state_display())
        self.message_user(request, done, messages.SUCCESS)
        return taken

    def _render(
        self, request: HttpRequest, name: str, front: FrontVersion | None, title: str, **context: Any
    ) -> HttpResponse:
        shown = self.admin_site.each_context(request) | {
            "title": title,
            "opts": self.opts,
            "front": front,
            "back": reverse("admin:fronts_frontversion_change", args=[front.pk]) if front else "",
        }
        return TemplateResponse(request, f"admin/fronts/frontversion/{name}.html", shown | context)


def _offered(request: HttpRequest, front: FrontVersion) -> list[Step]:
    """The steps that the state of `front` and the permissions of the user allow."""
    return [
        step
        for step in STEPS.values()
        if front.state in step.states
        and request.user.has_perm(step.permission)
        and not (step.name == "discard" and front.audit.exists())
    ]


def _published_by(step: Step, front: Front) -> Front:
    """The front that `step` publishes: `front` itself, or its content as the next version."""
    if step.name == "publish":
        return front
    version = selectors.next_version(front.application)
    return replace(front, content=structs.replace(front.content, version=version))


def _log(front: FrontVersion) -> QuerySet[AuditEntry]:
    return AuditEntry.objects.filter(subject=front.slug)


def _by_name(front: FrontVersion, of: Callable[[Point], dict[str, Any]]) -> SafeString:
    """A table with a row for each configuration of `front` for which `of` returns members."""
    return as_html({point.name: members for point in front.content.every if (members := of(point))})


def _by_sequence(errors: Iterable[SequenceResult]) -> dict[str, str]:
    """The largest error and the lost frames on each sequence."""
    return {
        error.sequence: f"{error.ate_max:.4f}" + (f", {error.lost} lost" if error.lost else "")
        for error in errors
    }


def _name(request: HttpRequest) -> str:
    return str(request.user.get_username())
