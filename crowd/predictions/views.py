"""Endpoints: the recommendation for a device, and the manifest with assigned probes."""

import math
from typing import Any

from django.http import HttpResponse, HttpResponseBase
from drf_spectacular.utils import OpenApiParameter, extend_schema
from rest_framework.request import Request

from crowd.access import limits
from crowd.devices.authentication import OptionalToken, installation_of_request
from crowd.fronts import intake_policy, manifests
from crowd.fronts import responses as front_answers
from crowd.fronts.views import ManifestView
from crowd.http.api import Endpoint, json_response
from crowd.http.problems import Problem, not_found
from crowd.predictions import probe_assignment, recommendations, responses, selectors
from crowd.predictions.selectors import DeviceQuery, PredictionResult
from slam.devices.device import BACKENDS
from wire.manifest import Manifest
from wire.protocol import PROBE_PAIRS, VALID_BELOW
from wire.recommendation import Recommendation

MAX_TEXT = 100
TEXT = {"type": "string", "maxLength": MAX_TEXT}
POSITIVE = {"type": "number", "exclusiveMinimum": 0}


class AssignedManifestView(ManifestView):
    """The manifest; for an installation with time left, that of a session of probes."""

    authentication_classes = [OptionalToken]

    def get_authenticators(self) -> list[Any]:
        """Ignore tokens without `minutes`: that manifest is the same for all clients."""
        http = getattr(self, "request", None)  # None while the OpenAPI document is made
        asks = http is None or "minutes" in http.GET
        return super().get_authenticators() if asks else []

    @extend_schema(
        operation_id="manifest",
        summary="What to measure now: front, protocol, sequence",
        description=(
            "With If-None-Match, an unchanged manifest is answered with 304. With minutes and a token, the "
            "response is for this installation: `assigned` lists the configurations that it is asked to "
            "measure, with the configurations and protocol of that session."
        ),
        parameters=[
            OpenApiParameter(
                "application",
                str,
                description="default: kfusion, or the first published application without it",
            ),
            OpenApiParameter("minutes", POSITIVE, description="time for a session of probes"),
        ],
        responses={200: Manifest, 304: None},
    )
    def get(self, request: Request) -> HttpResponseBase:
        if "minutes" not in request.query_params:
            return super().get(request)
        if request.auth is None:
            raise Problem("token_missing", "send Authorization: Bearer TOKEN with minutes")
        minutes = _positive_number(request, "minutes")
        application = request.query_params.get("application") or None
        assigned = probe_assignment.assign(installation_of_request(request), application, minutes)
        if assigned is None:
            raise Problem("no_front", "no front of this application is published here", field="application")
        try:
            manifests.require_current_program(assigned.front)
        except manifests.OutdatedFrontError as error:
            raise Problem("front_outdated", str(error)) from error
        asked = [(one.point, one.why) for one in assigned.probes]
        document = front_answers.assigned_manifest(
            assigned.front, intake_policy.current(), asked, PROBE_PAIRS, assigned.message
        )
        return json_response(document, headers={"Cache-Control": "private, no-store"})


class RecommendationView(Endpoint):
    """The recommended configuration for a device."""

    authentication_classes = [OptionalToken]
    throttle_classes = [limits.Reads]

    @extend_schema(
        operation_id="recommendation",
        summary="The configuration to use on a device: measured there, or predicted",
        description=(
            "Name a device by parts of its model, chip or system on a chip, or send a token for your own "
            "device. Without either, the response is for any device. The published best is recommended "
            "unless another point is predicted to win by more than its interval."
        ),
        parameters=[
            OpenApiParameter("application", TEXT, description="default: kfusion"),
            OpenApiParameter("model", TEXT, description="slug of the device, or words of its name"),
            OpenApiParameter("gpu", TEXT, description="part of the chip's name, such as Adreno 650"),
            OpenApiParameter("soc", TEXT, description="part of the name of the system on a chip"),
            OpenApiParameter("backend", str, enum=list(BACKENDS)),
            OpenApiParameter("max_ate", POSITIVE, description="largest error, m; default: 0.05"),
            OpenApiParameter("max_ms", POSITIVE, description="a sufficient time per frame, ms"),
        ],
        responses={200: Recommendation},
    )
    def get(self, request: Request) -> HttpResponse:
        prediction = _read_prediction(request)
        max_ate = _positive_number(request, "max_ate") if "max_ate" in request.query_params else VALID_BELOW
        max_ms = _positive_number(request, "max_ms") if "max_ms" in request.query_params else None
        try:
            document = responses.recommendation(prediction, max_ate, None if max_ms is None else max_ms / 1e3)
        except recommendations.LimitsNotMetError as error:
            raise not_found(str(error)) from error
        private = {"Cache-Control": "private, no-store"} if request.auth is not None else {}
        return json_response(document, headers=private)


def _read_prediction(request: Request) -> PredictionResult:
    query = request.query_params
    application = query.get("application") or None
    texts = {name: query.get(name, "").strip() for name in ("model", "gpu", "soc", "backend")}
    for name, text in texts.items():
        if len(text) > MAX_TEXT:
            raise Problem("invalid_filter", f"{name}: at most {MAX_TEXT} characters", field=name)
    if texts["backend"] not in ("", *BACKENDS):
        backends = ", ".join(BACKENDS)
        raise Problem("invalid_filter", f"backend={texts['backend']:.20}: give {backends}", field="backend")
    question = DeviceQuery(**texts)
    try:
        if request.auth is not None and question.anything:
            prediction = selectors.predict_for_installation(installation_of_request(request), application)
            if prediction is None:
                raise not_found("this installation has not measured this front yet: send a session first")
            return prediction
        return selectors.predict_for_query(question, application)
    except (selectors.NoFrontError, selectors.UnknownDeviceError) as error:
        raise not_found(str(error)) from error


def _positive_number(request: Request, name: str) -> float:
    text = request.query_params[name]
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise Problem("invalid_filter", f"{name}={text:.20}: give a number above 0", field=name)
    return value
