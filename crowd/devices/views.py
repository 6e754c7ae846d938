"""The API's addresses for the browser's client: models to choose from, and how far visitors came."""

import msgspec
from django.http import HttpResponse
from drf_spectacular.utils import OpenApiParameter, extend_schema
from rest_framework.request import Request

from crowd.api import Endpoint, answer, body
from crowd.decoding import decoded
from crowd.devices import attempts, model_choice
from crowd.problems import Problem

LONGEST_SEARCH = 100
ATTEMPT = msgspec.json.Decoder(attempts.Attempt)


class ModelAnswer(msgspec.Struct):
    """A model: `manufacturer` and `model` are what a client sends, `name` is for people."""

    manufacturer: str
    model: str
    name: str


class ModelsAnswer(msgspec.Struct):
    """At most 50 models."""

    results: list[ModelAnswer]


class ModelsView(Endpoint):
    """Models to choose from, for an owner whose browser does not name the device."""

    @extend_schema(
        operation_id="models",
        summary="Device models whose name holds the words of `search`, at most 50",
        parameters=[
            OpenApiParameter(
                "search", {"type": "string", "maxLength": LONGEST_SEARCH}, description="none where absent"
            )
        ],
        responses={200: ModelsAnswer},
    )
    def get(self, request: Request) -> HttpResponse:
        search = request.query_params.get("search", "")
        if len(search) > LONGEST_SEARCH:
            raise Problem(
                400, "invalid_filter", f"search has more than {LONGEST_SEARCH} characters", field="search"
            )
        rows = model_choice.matching(search)
        return answer(ModelsAnswer([ModelAnswer(row.manufacturer, row.model, row.name) for row in rows]))


class AttemptsView(Endpoint):
    """How far visitors of /measure/ came."""

    @extend_schema(
        operation_id="attempt",
        summary="Count one step of a visitor of /measure/, without who it was",
        request={"application/json": attempts.Attempt},
        responses={204: None},
    )
    def post(self, request: Request) -> HttpResponse:
        attempts.count(decoded(ATTEMPT, body(request)))
        return HttpResponse(status=204)
