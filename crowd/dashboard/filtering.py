"""Pages under filters: one form, one readable address.

The form works without a script; with htmx a change replaces `#results` and `#answer` alone and pushes the
shortest address that means the same.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, wraps
from typing import Any
from urllib.parse import parse_qsl, urlencode

from django.http import HttpRequest, HttpResponse, HttpResponseBase, HttpResponseRedirect, QueryDict
from django.utils.cache import patch_vary_headers

from crowd.dashboard.answering import page
from crowd.dashboard.comparing.application_choice import named, onward
from crowd.dashboard.drawings.drawing import with_query
from crowd.dashboard.sorting import Order
from crowd.devices.models import DeviceModel
from crowd.devices.naming.vendors import VENDORS
from crowd.fronts import selectors as published
from crowd.fronts.selectors import BEST, DEFAULT_APPLICATION
from crowd.results.reading import selectors as results
from crowd.results.reading.backends import BACKENDS
from crowd.results.reading.queries.filters import ALL, InvalidFilterError, SpeedupFilters

SYSTEMS = ("Android", "iOS", "Linux", "macOS", "Windows")
SCRIPT = "HX-Request"  # htmx asks with this header
OF_TABLE = frozenset({"page", "sort", "rows"})


@dataclass(frozen=True)
class Dropped:
    """One filter in words, how many figures there are without it, and the address of the page without it."""

    words: str
    figures: int
    address: str


@dataclass(frozen=True)
class Filtering:
    """What a visitor asked for. `problem` says what was not understood; everything is shown then.

    `others` are the page's own choices (a colour, a version to compare with) of the same address; `published`
    are the fronts to choose from, newest first, each with its application. `order` and `all_rows` are about
    the page's table alone: no chart depends on them.
    """

    path: str
    filters: SpeedupFilters
    problem: str
    others: QueryDict
    published: tuple[tuple[str, str], ...]
    order: Order
    all_rows: bool

    @classmethod
    def of(cls, request: HttpRequest) -> "Filtering":
        """The filters and other choices of the query string, without the page of a table."""
        names = published.names()
        try:
            filters, order, problem = results.parse_filters(request.GET, names), _order_of(request), ""
        except InvalidFilterError as error:
            filters, order, problem = results.parse_filters({}, names), Order.parse(""), str(error)
        others = QueryDict(mutable=True)
        for name, values in request.GET.lists():
            given = [value for value in values if value]
            if name not in SpeedupFilters.__dataclass_fields__ and name not in OF_TABLE and given:
                others.setlist(name, given)
        all_rows = request.GET.get("rows") == "all"
        return cls(request.path, filters, problem, others, names, order, all_rows)

    @property
    def query(self) -> str:
        """The shortest query string that means the same."""
        return "&".join(filter(None, [self.filters.query(), self.others.urlencode()]))

    @property
    def table_query(self) -> str:
        """The same with the order of the table."""
        return "&".join(filter(None, [self.query, urlencode(dict(self.table_fields))]))

    @property
    def table_fields(self) -> list[tuple[str, str]]:
        """What is asked of the table, by the names of a form's fields."""
        asked = (("sort", self.order.text), ("rows", "all" if self.all_rows else ""))
        return [(name, value) for name, value in asked if value]

    @property
    def address(self) -> str:
        """The address of the page under these filters."""
        return with_query(self.path, self.table_query)

    @property
    def with_all_rows(self) -> str:
        """The address of the page with the whole table."""
        return replace(self, all_rows=True).address

    def sorted_by(self, order: Order) -> str:
        """The address of the page with the table in ORDER."""
        return replace(self, order=order).address

    @property
    def fields(self) -> list[tuple[str, str]]:
        """The filters by the names of a form's fields, for a form that changes something else."""
        return parse_qsl(self.filters.query())

    @property
    def within(self) -> "Filtering":
        """The same for the page of a front, which is of one application."""
        return replace(self, filters=replace(self.filters, front="", application=DEFAULT_APPLICATION))

    @property
    def start(self) -> str:
        """The page with nothing of the application's crowd left out."""
        everything = SpeedupFilters(application=self.filters.application)
        return with_query(self.path, everything.query())

    @property
    def onward(self) -> str:
        """What the address of a device needs to go on with the application."""
        return onward(self.filters.application, self.published)

    @property
    def named(self) -> str:
        """The application, as a client has to name it to measure it; "" where it does so by itself."""
        return named(self.filters.application)

    def with_other(self, name: str, value: str) -> str:
        """The same address with the page's own choice NAME set to VALUE."""
        others = self.others.copy()
        others[name] = value
        return replace(self, others=others).address

    @property
    def described(self) -> str:
        """What is left of the application's crowd, in words; "" where nothing is left out."""
        return replace(self.filters, application=DEFAULT_APPLICATION).describe()

    @property
    def filtered(self) -> bool:
        """Whether anything of the application's crowd is left out."""
        return self.filters != SpeedupFilters(application=self.filters.application)

    def emptied_by(self) -> list[Dropped]:
        """The filters that leave nothing, each of which alone could be removed; none where only several
        together could. A read of the figures for each filter: call it for an empty answer.
        """
        found = []
        for without in self.filters.relaxed():
            if rows := results.speedups(without.filters).rows:
                address = replace(self, filters=without.filters).address
                found.append(Dropped(without.words, len(rows), address))
        return found

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
    def backends(self) -> dict[str, str]:
        """Backends to choose from, each with its name."""
        return BACKENDS

    @property
    def systems(self) -> tuple[str, ...]:
        """Operating systems to suggest."""
        return SYSTEMS

    @property
    def versions(self) -> Sequence[str]:
        """The application's fronts to choose from, newest first."""
        return [slug for slug, application in self.published if application == self.filters.application]

    @property
    def applications(self) -> list[tuple[str, str]]:
        """Applications that have a front, the default one first, each with the address of the page for it."""
        there = {application for _, application in self.published}
        names = sorted(there, key=lambda name: (name != DEFAULT_APPLICATION, name))

        def address(name: str) -> str:
            return replace(self, filters=replace(self.filters, application=name, front="")).address

        return [(name, address(name)) for name in names]

    @cached_property
    def simulations(self) -> bool:
        """Whether there are simulated devices to ask for."""
        simulated = DeviceModel.objects.filter(kind=DeviceModel.Kind.SIMULATED)
        return self.filters.simulated or simulated.exists()


def _order_of(request: HttpRequest) -> Order:
    return Order.parse(request.GET.get("sort", "").strip())


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
