"""Pages with filters: a form, and a readable address.

The form works without a script. With htmx, a change only replaces `#results` and `#answer`, and pushes the
shortest equivalent address.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from typing import Any
from urllib.parse import parse_qsl, urlencode

from django.http import HttpRequest, HttpResponse, HttpResponseBase, HttpResponseRedirect, QueryDict
from django.utils.cache import patch_vary_headers

from crowd.dashboard.comparing.application_choice import application_option, next_query
from crowd.dashboard.drawings.drawing import with_query
from crowd.dashboard.responses import page
from crowd.dashboard.sorting import Order
from crowd.devices.naming.chips import VENDORS
from crowd.fronts import selectors as published
from crowd.fronts.selectors import DEFAULT_APPLICATION
from crowd.results.reading import selectors as results
from crowd.results.reading.backends import BACKENDS
from crowd.results.reading.queries.filters import ALL, InvalidFilterError, SpeedupFilters
from wire.front import BEST

SYSTEMS = ("Android", "iOS", "Linux", "macOS", "Windows")
SCRIPT = "HX-Request"  # header of requests by htmx
OF_TABLE = frozenset({"page", "sort", "rows"})


@dataclass(frozen=True)
class Dropped:
    """A filter in words, the number of figures without it, and the address of the page without it."""

    words: str
    figures: int
    address: str


@dataclass(frozen=True)
class Filtering:
    """The filters and other choices of a request. If they are invalid, `problem` says why, and there are
    none.

    `others`: further choices of the page, such as a colour or a version to compare with. `published`: the
    fronts to choose from, newest first, each with its application. `order` and `all_rows` only affect the
    table.
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
        """Parse the query string of `request`, without the page of a table."""
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
        """The shortest equivalent query string."""
        return "&".join(filter(None, [self.filters.query(), self.others.urlencode()]))

    @property
    def table_query(self) -> str:
        """The query string with the order of the table."""
        return "&".join(filter(None, [self.query, urlencode(dict(self.table_fields))]))

    @property
    def table_fields(self) -> list[tuple[str, str]]:
        """The choices for the table, by field names of a form."""
        asked = (("sort", self.order.text), ("rows", "all" if self.all_rows else ""))
        return [(name, value) for name, value in asked if value]

    @property
    def address(self) -> str:
        """The address of the page with these filters."""
        return with_query(self.path, self.table_query)

    @property
    def with_all_rows(self) -> str:
        """The address of the page with the whole table."""
        return replace(self, all_rows=True).address

    def sorted_by(self, order: Order) -> str:
        """The address of the page with the table in `order`."""
        return replace(self, order=order).address

    @property
    def fields(self) -> list[tuple[str, str]]:
        """The filters by field names, as hidden fields of other forms."""
        return parse_qsl(self.filters.query())

    @property
    def front_scope(self) -> "Filtering":
        """These filters for the page of a front, without front and application."""
        return replace(self, filters=replace(self.filters, front="", application=DEFAULT_APPLICATION))

    @property
    def start(self) -> str:
        """The address of the page without filters, for the application."""
        everything = SpeedupFilters(application=self.filters.application)
        return with_query(self.path, everything.query())

    @property
    def next_query(self) -> str:
        """The query that keeps the application in links to devices."""
        return next_query(self.filters.application, self.published)

    @property
    def application_option(self) -> str:
        """The value of a client's option --application; "" for the default."""
        return application_option(self.filters.application)

    def with_other(self, name: str, value: str) -> str:
        """The address with the choice `name` of `others` set to `value`."""
        others = self.others.copy()
        others[name] = value
        return replace(self, others=others).address

    @property
    def described(self) -> str:
        """The filters in words, without the application; "" without filters."""
        return replace(self.filters, application=DEFAULT_APPLICATION).describe()

    @property
    def filtered(self) -> bool:
        """Whether there are filters in addition to the application."""
        return self.filters != SpeedupFilters(application=self.filters.application)

    def emptied_by(self) -> list[Dropped]:
        """The filters without any one of which there are results.

        It reads the figures once per filter, so call it only for an empty result.
        """
        dropped = []
        for without in self.filters.relaxed():
            if rows := results.speedups(without.filters).rows:
                address = replace(self, filters=without.filters).address
                dropped.append(Dropped(without.words, len(rows), address))
        return dropped

    @property
    def shown(self) -> str:
        """The compared configurations in words."""
        if self.filters.configuration == ALL:
            return "each configuration"
        return "the best one" if self.filters.configuration == BEST else self.filters.configuration

    @property
    def vendors(self) -> dict[str, str]:
        """Makers of graphics chips to choose from, with their full names."""
        return VENDORS

    @property
    def backends(self) -> dict[str, str]:
        """Backends to choose from, with their names."""
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
        """Applications with a front, the default first, each with the address of its page."""
        with_front = {application for _, application in self.published}
        names = sorted(with_front, key=lambda name: (name != DEFAULT_APPLICATION, name))

        def address(name: str) -> str:
            return replace(self, filters=replace(self.filters, application=name, front="")).address

        return [(name, address(name)) for name in names]


def _order_of(request: HttpRequest) -> Order:
    return Order.parse(request.GET.get("sort", "").strip())


def filtered(view: Callable[..., HttpResponse]) -> Callable[..., HttpResponseBase]:
    """A page whose `view` gets a Filtering after the request. 400 for invalid filters."""

    @page
    @wraps(view)
    def answer(request: HttpRequest, **arguments: Any) -> HttpResponseBase:
        asked = Filtering.of(request)
        by_script = SCRIPT in request.headers
        empty = any("" in values for _, values in request.GET.lists())
        if empty and not by_script and not asked.problem:
            # Without a script, a form also sends its empty fields.
            return HttpResponseRedirect(asked.address)
        response = view(request, asked, **arguments)
        if asked.problem:
            response.status_code = 400
        if by_script:
            response["HX-Push-Url"] = asked.address
        patch_vary_headers(response, [SCRIPT])
        return response

    return answer
