"""Pages under filters: one form, one readable address.

The form works without a script; with htmx a change replaces `#results` and `#answer` alone and pushes the
shortest address that means the same.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property, wraps
from typing import Any

from django.http import HttpRequest, HttpResponse, HttpResponseBase, HttpResponseRedirect, QueryDict
from django.utils.cache import patch_vary_headers

from crowd.dashboard.drawings.drawing import with_query
from crowd.dashboard.views.page import page
from crowd.devices.models import DeviceModel
from crowd.devices.vendors import VENDORS
from crowd.fronts import selectors as published
from crowd.fronts.selectors import BEST
from crowd.results.filters import ALL, InvalidFilterError, SpeedupFilters

SYSTEMS = ("Android", "Linux", "macOS", "Windows")
NAMED = 20  # so many names are told at most
SCRIPT = "HX-Request"  # htmx asks with this header


@dataclass(frozen=True)
class Filtering:
    """What a visitor asked for. `problem` says what was not understood; everything is shown then.

    `others` are the page's own choices (a colour, a version to compare with) of the same address.
    """

    path: str
    filters: SpeedupFilters
    problem: str
    others: QueryDict

    @classmethod
    def of(cls, request: HttpRequest) -> "Filtering":
        """The filters and other choices of the query string, without the page of a table."""
        try:
            filters, problem = _known(SpeedupFilters.parse(request.GET)), ""
        except InvalidFilterError as error:
            filters, problem = SpeedupFilters(), str(error)
        others = QueryDict(mutable=True)
        for name, values in request.GET.lists():
            given = [value for value in values if value]
            if name not in SpeedupFilters.__dataclass_fields__ and name != "page" and given:
                others.setlist(name, given)
        return cls(request.path, filters, problem, others)

    @property
    def query(self) -> str:
        """The shortest query string that means the same."""
        return "&".join(filter(None, [self.filters.query(), self.others.urlencode()]))

    @property
    def address(self) -> str:
        """The address of the page under these filters."""
        return with_query(self.path, self.query)

    def with_other(self, name: str, value: str) -> str:
        """The same address with the page's own choice NAME set to VALUE."""
        others = self.others.copy()
        others[name] = value
        return replace(self, others=others).address

    @property
    def filtered(self) -> bool:
        """Whether anything is left out."""
        return self.filters != SpeedupFilters()

    @property
    def shown(self) -> str:
        """Which configurations stand against the default, in words."""
        if self.filters.configuration == ALL:
            return "each configuration"
        return "the best one" if self.filters.configuration == BEST else self.filters.configuration

    @property
    def vendors(self) -> dict[str, str]:
        """Makers of graphics chips to choose from, each with its full name."""
        return VENDORS

    @property
    def systems(self) -> tuple[str, ...]:
        """Operating systems to suggest."""
        return SYSTEMS

    @cached_property
    def versions(self) -> tuple[tuple[str, str], ...]:
        """Fronts to choose from, newest first: slug and application."""
        return published.names()

    @property
    def applications(self) -> tuple[str, ...]:
        """Applications that have a front."""
        return tuple(dict.fromkeys(application for _, application in self.versions))

    @cached_property
    def simulations(self) -> bool:
        """Whether there are simulated devices to ask for."""
        simulated = DeviceModel.objects.filter(kind=DeviceModel.Kind.SIMULATED)
        return self.filters.simulated or simulated.exists()


def _known(filters: SpeedupFilters) -> SpeedupFilters:
    """FILTERS whose front and application exist; the defaults are not looked for.

    Raises InvalidFilterError.
    """
    default = SpeedupFilters()
    if (filters.front, filters.application) == (default.front, default.application):
        return filters
    names = published.names()
    if filters.front:
        _check("front", filters.front, [slug for slug, _ in names])
    if filters.application != default.application:
        _check("application", filters.application, [application for _, application in names])
    return filters


def _check(name: str, given: str, known: Iterable[str]) -> None:
    there = list(dict.fromkeys(known))
    if given not in there:
        right = f"give one of {', '.join(there[:NAMED])}" if there else "nothing has been published yet"
        raise InvalidFilterError(name, f"{name}={given:.50}: {right}")


def filtered(view: Callable[..., HttpResponse]) -> Callable[..., HttpResponseBase]:
    """A page whose VIEW gets the Filtering after the request. 400 where filters were not understood."""

    @page
    @wraps(view)
    def answer(request: HttpRequest, **arguments: Any) -> HttpResponseBase:
        asked = Filtering.of(request)
        by_script = SCRIPT in request.headers
        empty = any("" in values for _, values in request.GET.lists())
        if empty and not by_script and not asked.problem:
            # A form without a script sends its empty fields as well.
            return HttpResponseRedirect(asked.address)
        response = view(request, asked, **arguments)
        if asked.problem:
            response.status_code = 400
        if by_script:
            response["HX-Push-Url"] = asked.address
        patch_vary_headers(response, [SCRIPT])
        return response

    return answer
