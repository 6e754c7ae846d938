"""Explorations, for everybody to read."""

from django.http import HttpResponse
from drf_spectacular.utils import OpenApiParameter, extend_schema
from rest_framework.request import Request

from crowd.api import Endpoint, answer, page
from crowd.explorations import answers, selectors
from crowd.problems import not_found


class ExplorationsView(Endpoint):
    """Every exploration."""

    @extend_schema(
        operation_id="explorations",
        summary="Explorations and how far they have come, newest first",
        parameters=[OpenApiParameter("cursor", str), OpenApiParameter("limit", int)],
        responses={200: answers.ExplorationPage},
    )
    def get(self, request: Request) -> HttpResponse:
        rows = selectors.explorations()
        return answer(page(request, rows, lambda row: str(row.exploration.pk), answers.summary))


class ExplorationView(Endpoint):
    """One exploration in full."""

    @extend_schema(
        operation_id="exploration",
        summary="One exploration: what was measured and its front",
        responses={200: answers.ExplorationDetail},
    )
    def get(self, request: Request, key: int) -> HttpResponse:  # noqa: ARG002
        found = selectors.exploration(key)
        if found is None:
            raise not_found(f"no exploration {key}: GET /api/v1/explorations lists them")
        return answer(answers.detail(found))
