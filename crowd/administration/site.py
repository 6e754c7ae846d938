"""The admin site: its index lists models by what an administrator does."""

from functools import partial, wraps
from typing import Any

from django.http import HttpRequest, HttpResponse
from django.template.response import TemplateResponse
from django.urls import URLPattern, URLResolver, path, reverse

from crowd.access import logins
from crowd.administration import sections
from crowd.administration.public_page import NAME, public_page
from crowd.audit.services import acting
from crowd.operations.public import service


class AdministrationSite(logins.LogInSite):
    """The admin site, with an index in sections and the page "Before you go public"."""

    def get_urls(self) -> list[URLPattern | URLResolver]:
        page = self.admin_view(partial(public_page, site=self))
        return [path("public/", page, name=NAME), *super().get_urls()]

    def admin_view(self, view: Any, cacheable: bool = False) -> Any:
        """`view` for the staff alone.

        The audit log names the account where `view` changes accounts or roles.
        """

        @wraps(view)
        def by_account(request: HttpRequest, *args: Any, **kwargs: Any) -> HttpResponse:
            with acting(request.user.get_username()):
                response: HttpResponse = view(request, *args, **kwargs)
                return response

        return super().admin_view(by_account, cacheable)

    def index(self, request: HttpRequest, extra_context: dict[str, Any] | None = None) -> TemplateResponse:
        """The first page, with the health of the service."""
        return super().index(request, {"health": list(service.health_now())} | (extra_context or {}))

    def get_app_list(self, request: HttpRequest, app_label: str | None = None) -> list[Any]:
        """The models that the account may see, in sections; those of one application as Django lists them."""
        applications = super().get_app_list(request, app_label)
        if app_label is not None:
            return applications
        return sections.group_by_purpose(applications, reverse(f"{self.name}:index"))
