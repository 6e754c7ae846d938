"""The API's addresses that anybody may read of measurements: sessions and runs."""

from uuid import UUID

from django.http import HttpResponseBase
from drf_spectacular.types import OpenApiTypes
from drf_spectacular.utils import OpenApiParameter, extend_schema
from rest_framework.request import Request

from crowd.http.api import Endpoint, answer_or_unchanged, page_behind, refuse_unknown
from crowd.http.descriptions import PAGING
from crowd.http.problems import not_found
from crowd.results.api import answers
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
            "In the order of their start; a page goes on behind its last session, so that new ones are "
            "neither skipped nor repeated. Ask again with If-None-Match: 304 where the page has not changed."
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
        refuse_unknown(request, *names_of(SessionFilters), *PAGE_PARAMETERS)
        filters = understood(SessionFilters.parse, request)
        found = page_behind(
            request,
            lambda limit, last: lists.sessions(filters, limit, last),
            lambda row: str(row.uuid),
            answers.session,
        )
        return answer_or_unchanged(request, found)


class SessionView(Endpoint):
    """One session in full."""

    @extend_schema(
        operation_id="session",
        summary="One session: its speedups, the device's state, every run with its frames",
        description="Ask again with If-None-Match: 304 where nothing changed.",
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
            "In the order of the sessions' start; a page goes on behind its last run. `/sessions/{key}` has "
            "the times of frames. Ask again with If-None-Match: 304 where the page has not changed."
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
        refuse_unknown(request, *names_of(RunFilters), *PAGE_PARAMETERS)
        filters = understood(RunFilters.parse, request)
        found = page_behind(
            request,
            lambda limit, last: lists.runs(filters, limit, last),
            lambda row: str(row.uuid),
            answers.run,
        )
        return answer_or_unchanged(request, found)
