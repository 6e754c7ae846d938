"""Admin pages of devices: unknown devices and emulators, aliases to review, installations."""

from collections.abc import Callable
from functools import partial
from typing import Any
from urllib.parse import urlencode

from django.contrib import admin, messages
from django.db import transaction
from django.db.models import Count, QuerySet
from django.http import HttpRequest, HttpResponse
from django.shortcuts import redirect
from django.urls import reverse
from django.utils import timezone

from crowd.administration.readonly import ReadOnlyAdmin, ReadOnlyInline
from crowd.audit.services import record
from crowd.devices import attempts
from crowd.devices.aliases import decisions
from crowd.devices.models import (
    AttemptCount,
    CatalogueEntry,
    DeviceAlias,
    DeviceDescription,
    DeviceModel,
    DeviceSplit,
    Installation,
)

DECIDE = "devices.change_devicemodel"
MOST_ERASED = 100


class DecisionAdmin(ReadOnlyAdmin):
    """A read-only list, with actions for users who may decide about models."""

    def has_decide_permission(self, request: HttpRequest) -> bool:
        """Whether the user may run the actions. The forms stay read-only."""
        return bool(request.user.has_perm(DECIDE))

    def decide(self, request: HttpRequest, decision: Callable[[str], object], done: str) -> None:
        """Make a decision in the name of the user, and show the outcome as a message."""
        try:
            decision(request.user.get_username())
        except decisions.DecisionError as error:
            self.message_user(request, str(error), messages.ERROR)
        else:
            self.message_user(request, f"{done}; figures are updated within a minute")

    def decide_each(
        self, request: HttpRequest, rows: QuerySet[Any], decision: Callable[[Any, str], object], done: str
    ) -> None:
        """Decide row by row, so that a failure does not stop the others."""
        for row in rows.order_by("pk"):
            self.decide(request, partial(decision, row), f"{row}: {done}")


class SessionCount(ReadOnlyAdmin):
    """A column with the number of sessions, which are found by `sessions`."""

    sessions = "sessions"

    def get_queryset(self, request: HttpRequest) -> QuerySet[Any]:
        rows: QuerySet[Any] = super().get_queryset(request).annotate(session_count=Count(self.sessions))
        return rows

    @admin.display(description="sessions", ordering="session_count")
    def session_count(self, row: Any) -> int:
        return int(row.session_count)


class QueueFilter(admin.SimpleListFilter):
    """Unknown devices and emulators that no person has reviewed."""

    title = "queue"
    parameter_name = "queue"

    def lookups(self, request: HttpRequest, model_admin: Any) -> list[tuple[str, str]]:  # noqa: ARG002
        return [("unknown", "unknown devices"), ("emulator", "emulators")]

    def queryset(self, request: HttpRequest, queryset: QuerySet[DeviceModel]) -> QuerySet[DeviceModel]:  # noqa: ARG002
        return queryset.filter(kind=self.value(), judged_by="") if self.value() else queryset


class DescriptionInline(ReadOnlyInline):
    model = DeviceDescription
    fields = ("first_seen_at", "driver_name", "driver_version", "raw")
    readonly_fields = ("first_seen_at",)


@admin.register(DeviceModel)
class DeviceModelAdmin(SessionCount, DecisionAdmin):
    """Models, with the raw strings that they are derived from."""

    list_display = (
        "display_name", "manufacturer", "soc", "gpu", "os", "kind", "named", "rare", "canonical",
        "session_count", "created_at",
    )  # fmt: skip
    list_filter = (
        QueueFilter,
        "kind",
        "named",
        "rare",
        "os",
        ("canonical", admin.EmptyFieldListFilter),
        "manufacturer",
    )
    search_fields = ("name", "market_name", "manufacturer", "slug", "soc", "gpu", "cpu")
    list_select_related = ("canonical",)
    inlines = (DescriptionInline,)
    actions = ("merge", "is_device", "is_emulator", "reset_kind")
    sessions = "descriptions__sessions"

    @admin.action(description="Merge into the model with most sessions", permissions=["decide"])
    def merge(self, request: HttpRequest, queryset: QuerySet[DeviceModel]) -> None:
        models = sorted(queryset, key=lambda model: (-self.session_count(model), model.pk))
        self.decide(
            request,
            lambda by: decisions.merge(models, models[0], by),
            f"{len(models) - 1} merged into {models[0]}",
        )

    @admin.action(description="Mark as real, known devices", permissions=["decide"])
    def is_device(self, request: HttpRequest, queryset: QuerySet[DeviceModel]) -> None:
        self.set_kind(request, queryset, DeviceModel.Kind.DEVICE)

    @admin.action(description="Mark as emulators", permissions=["decide"])
    def is_emulator(self, request: HttpRequest, queryset: QuerySet[DeviceModel]) -> None:
        self.set_kind(request, queryset, DeviceModel.Kind.EMULATOR)

    def set_kind(self, request: HttpRequest, queryset: QuerySet[DeviceModel], kind: DeviceModel.Kind) -> None:
        models = list(queryset)
        done = f"{len(models)} marked as {kind}s"
        self.decide(request, lambda by: decisions.set_kind(models, kind, by), done)

    @admin.action(description="Undo marking: let the rules decide", permissions=["decide"])
    def reset_kind(self, request: HttpRequest, queryset: QuerySet[DeviceModel]) -> None:
        models = list(queryset)
        self.decide(request, lambda _by: decisions.reset_kind(models), f"{len(models)} left to the rules")


@admin.register(DeviceDescription)
class DeviceDescriptionAdmin(DecisionAdmin):
    """Raw strings as sent. Some of a model can be split off into a new model."""

    list_display = ("model", "driver_name", "driver_version", "rules", "split", "first_seen_at")
    list_filter = ("driver_name", ("split", admin.EmptyFieldListFilter))
    search_fields = ("model__name", "model__manufacturer", "digest")
    list_select_related = ("model", "split__model", "split__source")
    actions = ("split_off",)

    @admin.action(description="Split off into a model of their own", permissions=["decide"])
    def split_off(self, request: HttpRequest, queryset: QuerySet[DeviceDescription]) -> None:
        rows = list(queryset)
        self.decide(request, lambda by: decisions.split(rows, by), f"{len(rows)} descriptions split off")


@admin.register(DeviceAlias)
class DeviceAliasAdmin(DecisionAdmin):
    """Proposals to review, and all decisions with who made and who undid them."""

    list_display = (
        "alias", "model", "reason", "state", "proposed_at", "decided_by", "decided_at", "undone_by",
    )  # fmt: skip
    list_filter = ("state", "reason", "model__manufacturer")
    search_fields = ("alias__name", "model__name", "model__market_name", "model__manufacturer")
    list_select_related = ("alias", "model")
    actions = ("accept", "refuse", "undo")

    @admin.action(description="Accept: show the alias as the model", permissions=["decide"])
    def accept(self, request: HttpRequest, queryset: QuerySet[DeviceAlias]) -> None:
        self.decide_each(
            request, queryset, partial(decisions.decide, state=DeviceAlias.State.ACCEPTED), "merged"
        )

    @admin.action(description="Refuse: these are two devices", permissions=["decide"])
    def refuse(self, request: HttpRequest, queryset: QuerySet[DeviceAlias]) -> None:
        self.decide_each(
            request, queryset, partial(decisions.decide, state=DeviceAlias.State.REFUSED), "refused"
        )

    @admin.action(description="Undo the decision", permissions=["decide"])
    def undo(self, request: HttpRequest, queryset: QuerySet[DeviceAlias]) -> None:
        self.decide_each(request, queryset, decisions.undo, "undone")


@admin.register(DeviceSplit)
class DeviceSplitAdmin(DecisionAdmin):
    """Splits, with who made and who undid them."""

    list_display = ("model", "source", "decided_by", "decided_at", "undone_by", "undone_at")
    list_filter = (("undone_at", admin.EmptyFieldListFilter),)
    list_select_related = ("model", "source")
    actions = ("undo",)

    @admin.action(description="Undo: put the descriptions back", permissions=["decide"])
    def undo(self, request: HttpRequest, queryset: QuerySet[DeviceSplit]) -> None:
        self.decide_each(request, queryset, decisions.undo_split, "undone")


@admin.register(CatalogueEntry)
class CatalogueEntryAdmin(ReadOnlyAdmin):
    """Imported catalogue entries."""

    list_display = ("market_name", "maker", "code", "device", "soc", "gpu")
    search_fields = ("market_name", "code", "device", "maker")


@admin.register(AttemptCount)
class AttemptCountAdmin(ReadOnlyAdmin):
    """Counts of visitors of the measuring page: how far they came, and why they stopped."""

    list_display = ("day", "step", "reason", "gpu_vendor", "gpu_architecture", "browser", "count")
    list_filter = ("step", "reason", "browser", "gpu_vendor", "gpu_architecture")
    date_hierarchy = "day"

    def changelist_view(self, request: HttpRequest, extra_context: Any = None) -> HttpResponse:
        """The list, with sums over its rows."""
        response = super().changelist_view(request, extra_context)
        context = getattr(response, "context_data", None) or {}
        if "cl" in context:
            context["summary"] = attempts.summary(context["cl"].queryset)
        return response


@admin.register(Installation)
class InstallationAdmin(SessionCount):
    """Anonymous installations; a token can be revoked."""

    list_display = (
        "id",
        "app",
        "app_version",
        "consent_version",
        "show_model",
        "session_count",
        "created_at",
        "revoked_at",
    )
    list_filter = (
        "app",
        "app_version",
        "consent_version",
        "show_model",
        ("revoked_at", admin.EmptyFieldListFilter),
    )
    search_fields = ("id", "=network")
    exclude = ("token_sha256", "next_token_sha256")
    # The network is shown because the page that erases a network asks for it.
    readonly_fields = ("network", "description")
    actions = ("revoke", "erase")

    @admin.action(description="Revoke the selected installations' tokens", permissions=["revoke"])
    def revoke(self, request: HttpRequest, queryset: QuerySet[Installation]) -> None:
        with transaction.atomic():
            chosen = Installation.objects.filter(pk__in=queryset.values("pk"), revoked_at=None)
            rows = list(chosen.select_for_update())
            Installation.objects.filter(pk__in=[row.pk for row in rows]).update(revoked_at=timezone.now())
            for row in rows:
                record(request.user.get_username(), "token revoked", f"installation {row.pk}")
        self.message_user(request, f"{len(rows)} tokens revoked: those clients must enrol again")

    @admin.action(description="Erase the selected installations...", permissions=["erase"])
    def erase(self, request: HttpRequest, queryset: QuerySet[Installation]) -> HttpResponse | None:
        keys = [str(key) for key in queryset.values_list("pk", flat=True)[: MOST_ERASED + 1]]
        if len(keys) > MOST_ERASED:
            text = f"Select at most {MOST_ERASED} installations, or erase a network or a period instead"
            self.message_user(request, text, messages.ERROR)
            return None
        page = reverse("admin:results_erase_measurements")
        return redirect(f"{page}?{urlencode({'installations': ' '.join(keys)})}")

    def has_erase_permission(self, request: HttpRequest) -> bool:
        return bool(request.user.has_perm("results.erase_measurements"))

    def has_revoke_permission(self, request: HttpRequest) -> bool:
        """Whether the user may revoke tokens. The form stays read-only."""
        return bool(request.user.has_perm("devices.change_installation"))
