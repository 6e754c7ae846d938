"""Public endpoints of measurements: sessions and runs."""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar
from uuid import UUID

from django.http import HttpResponseBase
from drf_spectacular.types import OpenApiTypes
from drf_spectacular.utils import OpenApiParameter, extend_schema
from rest_framework.request import Request

from crowd.http.api import Endpoint, paginate_query, public_json, reject_unknown_parameters
from crowd.http.descriptions import PAGINATION
from crowd.http.problems import not_found
from crowd.records.run import RunRow
from crowd.records.session import SessionRow
from crowd.results.api import session_responses as responses
from crowd.results.api.parameters import (
    DEVICE_PARAMETERS,
    PAGE_PARAMETERS,
    PERIOD_PARAMETERS,
    SIMULATED_PARAMETER,
    SWITCH,
    TEXT,
    parse_query,
)
from crowd.results.reading import lists, selectors
from crowd.results.reading.queries.list_filters import RunFilters, SessionFilters

F = TypeVar("F", bound=SessionFilters)
R = TypeVar("R", SessionRow, RunRow)
FRONT_PARAMETERS = [
    OpenApiParameter("application", TEXT, description="such as kfusion; default: all"),
    OpenApiParameter("front", TEXT, description="version; default: all"),
]
CONFIRMED_PARAMETER = OpenApiParameter(
    "confirmed",
    SWITCH,
    description=(
        "1: only sessions whose figure (of `configuration`, else of best) independent installations confirm; "
        "0: only the others"
    ),
)


class SessionsView(Endpoint):
    """All sessions."""

    @extend_schema(
        operation_id="sessions",
        summary="Measured sessions with their speedups, newest first",
        description=(
            "In the order of their start. The next page starts after the last session, so that new sessions "
            "do not shift it. With If-None-Match, an unchanged page is answered with 304."
        ),
        parameters=[
            *FRONT_PARAMETERS,
            OpenApiParameter("configuration", TEXT, description="only sessions with a speedup of it"),
            *DEVICE_PARAMETERS,
            *PERIOD_PARAMETERS,
            OpenApiParameter(
                "valid",
                SWITCH,
                description="1: only sessions with a valid speedup; 0: with one that is not valid",
            ),
            CONFIRMED_PARAMETER,
            SIMULATED_PARAMETER,
            *PAGINATION,
        ],
        responses={200: responses.SessionPage, 304: None},
    )
    def get(self, request: Request) -> HttpResponseBase:
        return _page(request, SessionFilters, lists.sessions, responses.session)


class SessionView(Endpoint):
    """One session in full."""

    @extend_schema(
        operation_id="session",
        summary="One session: its speedups, the device's state, every run with its frames",
        description="With If-None-Match, an unchanged session is answered with 304.",
        responses={200: responses.SessionDetailAnswer, 304: None},
    )
    def get(self, request: Request, key: UUID) -> HttpResponseBase:
        reject_unknown_parameters(request)
        session = selectors.session(key)
        if session is None:
            raise not_found(f"no session {key}: GET /api/v1/sessions lists them")
        return public_json(request, responses.session_detail(session))


class RunsView(Endpoint):
    """All runs."""

    @extend_schema(
        operation_id="runs",
        summary="Runs of all sessions, newest first",
        description=(
            "In the order of the sessions' start. The next page starts after the last run. "
            "`/sessions/{key}` has the times of frames. "
            "With If-None-Match, an unchanged page is answered with 304."
        ),
        parameters=[
            OpenApiParameter("session", OpenApiTypes.UUID, description="only the runs of this session"),
            *FRONT_PARAMETERS,
            OpenApiParameter("configuration", TEXT, description="only runs of it"),
            *DEVICE_PARAMETERS,
            *PERIOD_PARAMETERS,
            OpenApiParameter("valid", SWITCH, description="1: only valid runs; 0: only the others"),
            CONFIRMED_PARAMETER,
            SIMULATED_PARAMETER,
            *PAGINATION,
        ],
        responses={200: responses.RunPage, 304: None},
    )
    def get(self, request: Request) -> HttpResponseBase:
        return _page(request, RunFilters, lists.runs, responses.run)


def _page(
    request: Request,
    kind: type[F],
    read: Callable[[F, int, str | None], Sequence[R] | None],
    encode: Callable[[R], Any],
) -> HttpResponseBase:
    """A page of the rows that `read` finds for the filters (a `kind`) of `request`."""
    reject_unknown_parameters(request, *kind.names(), *PAGE_PARAMETERS)
    filters = parse_query(kind.parse, request)
    page = paginate_query(
        request, lambda limit, last: read(filters, limit, last), lambda row: str(row.uuid), encode
    )
    return public_json(request, page)
