"""Admin pages in addition to Django's lists and forms."""

from collections.abc import Callable
from typing import Any

from django.contrib import admin, messages
from django.core.exceptions import PermissionDenied
from django.http import HttpRequest, HttpResponse
from django.template.response import TemplateResponse
from django.urls import URLPattern, path


class PagesAdmin(admin.ModelAdmin):  # type: ignore[type-arg]  # not generic at run time
    """A ModelAdmin with helpers for pages of its own."""

    def _route(self, route: str, view: Callable[..., HttpResponse], name: str) -> URLPattern:
        label = f"{self.opts.app_label}_{self.opts.model_name}_{name}"
        return path(route, self.admin_site.admin_view(view), name=label)

    def _get_or_deny(self, request: HttpRequest, key: int, permission: str) -> Any:
        """The row with `key`. Raises PermissionDenied, also if the row does not exist."""
        row = self.get_object(request, str(key))
        if row is None or not request.user.has_perm(permission):
            raise PermissionDenied
        return row

    def _render(
        self, request: HttpRequest, template: str, row: Any, title: str, **context: Any
    ) -> HttpResponse:
        shown = self.admin_site.each_context(request) | {"title": title, "opts": self.opts, "row": row}
        return TemplateResponse(request, f"admin/{self.opts.app_label}/{template}.html", shown | context)

    def _show_refusal(self, request: HttpRequest, error: Exception) -> None:
        text = "; ".join(getattr(error, "messages", [str(error)]))
        self.message_user(request, f"Nothing was done: {text}", messages.ERROR)
