"""The administration's site: its first page is arranged by what an administrator does."""

from typing import Any

from django.http import HttpRequest
from django.urls import reverse

from crowd.access import logins
from crowd.administration import sections


class Site(logins.Site):
    """The site with the log-in of crowd.access.logins."""

    def get_app_list(self, request: HttpRequest, app_label: str | None = None) -> list[Any]:
        """The lists that the account may see, in sections; of one application as Django arranges them."""
        applications = super().get_app_list(request, app_label)
        if app_label is not None:
            return applications
        return sections.by_purpose(applications, reverse(f"{self.name}:index"))
