"""API for browsers before they measure: counting attempts, and models to choose from."""

import msgspec
from django.http import HttpResponse, HttpResponseBase
from drf_spectacular.utils import OpenApiParameter, extend_schema
from rest_framework.request import Request

from crowd.access import limits
from crowd.devices import attempts, model_choice
from crowd.http.api import Endpoint, public_json, read_body, reject_unknown_parameters
from crowd.http.decoding import decode_body
from crowd.http.problems import Problem

LONGEST = 100


class ModelChoices(msgspec.Struct):
    """Models sorted by name."""

    results: list[model_choice.ModelChoice]


class AttemptsView(Endpoint):
    """Counts steps of measuring in a browser."""

    throttle_classes = [limits.Attempts]

    @extend_schema(
        operation_id="attempt",
        summary="Count a step of measuring in a browser",
        description=(
            "Daily counts by step, reason, graphics chip and browser. Addresses and times of day are not "
            "stored. The counts are not published."
        ),
        request={"application/json": attempts.Attempt},
        responses={204: None},
    )
    def post(self, request: Request) -> HttpResponse:
        attempts.count(decode_body(attempts.DECODER, read_body(request)))
        return HttpResponse(status=204)


class ModelsView(Endpoint):
    """Models that an owner can choose."""

    @extend_schema(
        operation_id="models",
        summary="Models that an owner can choose if the device does not report its model",
        parameters=[
            OpenApiParameter("maker", str, description="full name of a maker, as Samsung"),
            OpenApiParameter("search", str, description="words of the name, or a code"),
        ],
        responses={200: ModelChoices},
    )
    def get(self, request: Request) -> HttpResponseBase:
        reject_unknown_parameters(request, "maker", "search")
        asked = {name: request.query_params.get(name, "") for name in ("maker", "search")}
        for name, text in asked.items():
            if len(text) > LONGEST:
                raise Problem(
                    "invalid_filter",
                    f"{name} has {len(text)} characters: give at most {LONGEST}",
                    field=name,
                )
        return public_json(request, ModelChoices(model_choice.find(**asked)))
