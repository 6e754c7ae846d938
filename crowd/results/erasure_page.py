"""The page of the administration that erases measurements: form, preview and confirmation."""

from typing import Any
from uuid import UUID

from django import forms
from django.contrib import messages
from django.contrib.admin import AdminSite
from django.core.exceptions import PermissionDenied
from django.http import HttpRequest, HttpResponse
from django.shortcuts import redirect
from django.template.response import TemplateResponse
from django.utils import timezone

from crowd.devices.models import DeviceModel
from crowd.results.models import Tombstone
from crowd.results.privacy.selected_erasure import Selection, erase, preview

ERASE = "results.erase_measurements"
MAX_INSTALLATIONS = 100
TEMPLATE = "admin/results/erase_measurements.html"


class SelectionForm(forms.Form):
    """What to erase: everything that meets all given conditions."""

    installations = forms.CharField(
        required=False,
        widget=forms.Textarea(attrs={"rows": 4, "class": "vLargeTextField"}),
        help_text=f"Ids with spaces or line breaks between them, at most {MAX_INSTALLATIONS}.",
    )
    network = forms.CharField(
        required=False, max_length=32, help_text="The keyed hash that the page of an installation shows."
    )
    device = forms.CharField(
        required=False, max_length=120, help_text="The slug of a device model, such as google-pixel-8."
    )
    since = forms.DateTimeField(required=False, help_text="Received from then on (UTC): 2026-11-20 14:00.")
    until = forms.DateTimeField(required=False, help_text="Received before (UTC).")
    reason = forms.CharField(max_length=300, help_text="For the log. Name no participant.")

    def clean_installations(self) -> tuple[UUID, ...]:
        """Raises ValidationError for text that is not an id, and for too many of them."""
        words = self.cleaned_data["installations"].split()
        if len(words) > MAX_INSTALLATIONS:
            raise forms.ValidationError(
                f"{len(words)} installations: give at most {MAX_INSTALLATIONS}, their network or a period"
            )
        try:
            return tuple(map(UUID, words))
        except ValueError:
            raise forms.ValidationError(
                "not the id of an installation: copy it from the list of installations"
            ) from None

    def clean_device(self) -> str:
        """Raises ValidationError for a slug that no model has."""
        slug = str(self.cleaned_data["device"])
        if slug and not DeviceModel.objects.filter(slug=slug).exists():
            raise forms.ValidationError(
                f"no device model has the slug {slug!r}: copy it from the list of models"
            )
        return slug

    def clean(self) -> dict[str, Any]:
        """Adds `selection`. Raises ValidationError without a condition."""
        data = super().clean() or {}
        if not self.errors:
            conditions = {name: value for name, value in data.items() if name != "reason"}
            try:
                data["selection"] = Selection(**conditions)
            except ValueError as error:
                raise forms.ValidationError(str(error)) from None
        return data


def erase_measurements(request: HttpRequest, site: AdminSite) -> HttpResponse:
    """The page; 403 for users without the permission."""
    if not request.user.has_perm(ERASE):
        raise PermissionDenied
    if request.method != "POST":
        form = SelectionForm(initial={"installations": request.GET.get("installations", "")})
        return _page(request, site, form)
    form = SelectionForm(request.POST)
    if not form.is_valid():
        return _page(request, site, form)
    selection: Selection = form.cleaned_data["selection"]
    if "confirm" not in request.POST:
        return _page(request, site, _limited(request, selection), preview=preview(selection))
    erased = erase(selection, str(request.user.get_username()), form.cleaned_data["reason"])
    text = (
        f"Erased {erased.sessions} sessions with {erased.runs} runs of {erased.installations} installations"
    )
    messages.success(request, text)
    return redirect("admin:results_erase_measurements")


def _limited(request: HttpRequest, selection: Selection) -> SelectionForm:
    """The form to confirm. For a device or a period, it excludes data that arrives after the preview."""
    data = request.POST.copy()
    if not selection.of_whole_installations and selection.until is None:
        data["until"] = timezone.now().isoformat()
    form = SelectionForm(data)
    form.full_clean()
    return form


def _page(request: HttpRequest, site: AdminSite, form: SelectionForm, **context: Any) -> HttpResponse:
    shown = site.each_context(request) | {
        "title": "Erase measurements",
        "opts": Tombstone._meta,
        "form": form,
        "selection": form.is_bound and form.cleaned_data.get("selection"),
    }
    return TemplateResponse(request, TEMPLATE, shown | context)
