"""The API's public addresses of measurements: sessions and runs."""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar
from uuid import UUID

from django.http import HttpResponseBase
from drf_spectacular.types import OpenApiTypes
from drf_spectacular.utils import OpenApiParameter, extend_schema
from rest_framework.request import Request

from crowd.http.api import Endpoint, answer_or_unchanged, page_behind, refuse_unknown
from crowd.http.descriptions import PAGING
from crowd.http.problems import not_found
from crowd.results.api import session_answers as answers
from crowd.results.api.parameters import (
    DEVICE,
    PAGE_PARAMETERS,
    PERIOD,
    SIMULATED,
    SWITCH,
    TEXT,
    names_of,
    understood,
)
from crowd.results.reading import lists, selectors
from crowd.results.reading.queries.list_filters import RunFilters, SessionFilters
from crowd.results.reading.rows import ListedRun, SessionRow

F = TypeVar("F", bound=SessionFilters)
R = TypeVar("R", SessionRow, ListedRun)
SCOPE = [
    OpenApiParameter("application", TEXT, description="such as kfusion; every one where absent"),
    OpenApiParameter("front", TEXT, description="version; every one where absent"),
]
CONFIRMED = OpenApiParameter(
    "confirmed",
    SWITCH,
    description=(
        "1: only sessions behind a figure that independent installations confirm, of `configuration` or else "
        "of best; 0: only the others"
    ),
)


class SessionsView(Endpoint):
    """Every session."""

    @extend_schema(
        operation_id="sessions",
        summary="Measured sessions with their speedups, newest first",
        description=(
            "In the order of their start. The next page starts behind the last session, so that new ones are "
            "neither skipped nor repeated. With If-None-Match the answer is 304 where the page is the same."
        ),
        parameters=[
            *SCOPE,
            OpenApiParameter("configuration", TEXT, description="only sessions with a speedup of it"),
            *DEVICE,
            *PERIOD,
            OpenApiParameter(
                "valid",
                SWITCH,
                description="1: only sessions with a valid speedup of it; 0: with one that is not valid",
            ),
            CONFIRMED,
            SIMULATED,
            *PAGING,
        ],
        responses={200: answers.SessionPage, 304: None},
    )
    def get(self, request: Request) -> HttpResponseBase:
        return _page(request, SessionFilters, lists.sessions, answers.session)


class SessionView(Endpoint):
    """One session in full."""

    @extend_schema(
        operation_id="session",
        summary="One session: its speedups, the device's state, every run with its frames",
        description="With If-None-Match the answer is 304 where nothing changed.",
        responses={200: answers.SessionDetailAnswer, 304: None},
    )
    def get(self, request: Request, key: UUID) -> HttpResponseBase:
        refuse_unknown(request)
        found = selectors.session(key)
        if found is None:
            raise not_found(f"no session {key}: GET /api/v1/sessions lists them")
        return answer_or_unchanged(request, answers.session_detail(found))


class RunsView(Endpoint):
    """Every run."""

    @extend_schema(
        operation_id="runs",
        summary="Runs of all sessions, newest first",
        description=(
            "In the order of the sessions' start. The next page starts behind the last run. "
            "`/sessions/{key}` has the times of frames. "
            "With If-None-Match the answer is 304 where the page is the same."
        ),
        parameters=[
            OpenApiParameter("session", OpenApiTypes.UUID, description="only the runs of this session"),
            *SCOPE,
            OpenApiParameter("configuration", TEXT, description="only runs of it"),
            *DEVICE,
            *PERIOD,
            OpenApiParameter("valid", SWITCH, description="1: only valid runs; 0: only the others"),
            CONFIRMED,
            SIMULATED,
            *PAGING,
        ],
        responses={200: answers.RunPage, 304: None},
    )
    def get(self, request: Request) -> HttpResponseBase:
        return _page(request, RunFilters, lists.runs, answers.run)


def _page(
    request: Request,
    kind: type[F],
    read: Callable[[F, int, str | None], Sequence[R] | None],
    encode: Callable[[R], Any],
) -> HttpResponseBase:
    """A page of what READ finds under the filters of REQUEST, which are of that KIND."""
    refuse_unknown(request, *names_of(kind), *PAGE_PARAMETERS)
    filters = understood(kind.parse, request)
    found = page_behind(
        request, lambda limit, last: read(filters, limit, last), lambda row: str(row.uuid), encode
    )
    return answer_or_unchanged(request, found)
