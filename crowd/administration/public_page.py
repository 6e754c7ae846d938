"""The administration's page "Before you go public"."""

from django.contrib import admin, messages
from django.core.exceptions import PermissionDenied
from django.http import HttpRequest, HttpResponse
from django.shortcuts import redirect
from django.template.response import TemplateResponse

from crowd.operations.public import checks, people

NAME = "public"


def public_page(request: HttpRequest, site: admin.AdminSite) -> HttpResponse:
    """The check list, with buttons for what only a person can confirm.

    Only superusers see it, because it names settings and accounts without one-time passwords.
    """
    if not request.user.is_superuser:
        raise PermissionDenied
    if request.method == "POST":
        confirmation = people.CONFIRMATIONS.get(request.POST.get("confirm", ""))
        if confirmation is None:
            raise PermissionDenied
        people.confirm(confirmation.name, request.user.get_username())
        messages.success(request, f"Logged: {confirmation.action}")
        return redirect(f"{site.name}:{NAME}")
    results = checks.run()
    context = site.each_context(request) | {
        "title": "Before you go public",
        "results": results,
        "counts": checks.counts(results),
    }
    return TemplateResponse(request, "admin/public.html", context)
