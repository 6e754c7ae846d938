"""What to use on a device, and what a device is asked to measure for the map."""

import math
from typing import Any

from django.http import HttpResponse, HttpResponseBase
from drf_spectacular.utils import OpenApiParameter, extend_schema
from rest_framework.request import Request

from crowd.access import limits
from crowd.devices.authentication import OptionalToken, installation_of_request
from crowd.fronts import policy
from crowd.fronts import responses as front_answers
from crowd.fronts.views import ManifestView
from crowd.http.api import Endpoint, json_response
from crowd.http.problems import Problem, not_found
from crowd.predictions import assigning, recommending, responses, selectors
from crowd.predictions.selectors import Answer, Question
from slam.devices.device import BACKENDS
from slam.protocol import PROBE_PAIRS, VALID_BELOW

LONGEST = 100
TEXT = {"type": "string", "maxLength": LONGEST}
POSITIVE = {"type": "number", "exclusiveMinimum": 0}


class AssignedManifestView(ManifestView):
    """The manifest; for an installation that has time left, that of a session of probes."""

    authentication_classes = [OptionalToken]

    def get_authenticators(self) -> list[Any]:
        """A token means nothing to the manifest that is the same for everyone, not even a wrong one."""
        http = getattr(self, "request", None)  # none while the API is described
        asks = http is None or "minutes" in http.GET
        return super().get_authenticators() if asks else []

    @extend_schema(
        operation_id="manifest",
        summary="What to measure now: front, protocol, sequence",
        description=(
            "Ask again with If-None-Match: an unchanged manifest answers 304 with no body. With minutes and "
            "a token the answer is for this installation alone: what it is asked to measure besides, in "
            "`assigned`, and the configurations and protocol of that session."
        ),
        parameters=[
            OpenApiParameter(
                "application",
                str,
                description="where absent kfusion, or what was published first where that is not published",
            ),
            OpenApiParameter("minutes", POSITIVE, description="how long another session may take"),
        ],
        responses={200: front_answers.Manifest, 304: None},
    )
    def get(self, request: Request) -> HttpResponseBase:
        if "minutes" not in request.query_params:
            return super().get(request)
        if request.auth is None:
            raise Problem("token_missing", "send Authorization: Bearer TOKEN with minutes")
        minutes = _positive(request, "minutes")
        application = request.query_params.get("application") or None
        found = assigning.assign(installation_of_request(request), application, minutes)
        if found is None:
            raise Problem("no_front", "no such front is published here", field="application")
        asked = [(one.point, one.why) for one in found.probes]
        document = front_answers.assigned_manifest(
            found.front, policy.current(), asked, PROBE_PAIRS, found.message
        )
        return json_response(document, headers={"Cache-Control": "private, no-store"})


class RecommendationView(Endpoint):
    """What to use on a device."""

    authentication_classes = [OptionalToken]
    throttle_classes = [limits.Reads]

    @extend_schema(
        operation_id="recommendation",
        summary="The configuration to use on a device: measured there, or predicted",
        description=(
            "Name a device by parts of its model, chip or system on a chip, or send a token: then it is your "
            "own. Without either the answer is for any device. The published best is recommended unless "
            "another point is predicted to win by more than its interval."
        ),
        parameters=[
            OpenApiParameter("application", TEXT, description="kfusion where absent"),
            OpenApiParameter("model", TEXT, description="its address here, or words of its name"),
            OpenApiParameter("gpu", TEXT, description="part of the chip's name, such as Adreno 650"),
            OpenApiParameter("soc", TEXT, description="part of the name of the system on a chip"),
            OpenApiParameter("backend", str, enum=list(BACKENDS)),
            OpenApiParameter("max_ate", POSITIVE, description="largest error allowed, m; 0.05 where absent"),
            OpenApiParameter("max_ms", POSITIVE, description="a time a frame that is fast enough, ms"),
            OpenApiParameter("simulated", {"type": "string", "enum": ["0", "1"]}),
        ],
        responses={200: responses.Recommendation},
    )
    def get(self, request: Request) -> HttpResponse:
        found = _asked(request)
        max_ate = _positive(request, "max_ate") if "max_ate" in request.query_params else VALID_BELOW
        max_ms = _positive(request, "max_ms") if "max_ms" in request.query_params else None
        try:
            document = responses.recommendation(found, max_ate, None if max_ms is None else max_ms / 1e3)
        except recommending.NothingKeepsLimitsError as error:
            raise not_found(str(error)) from error
        private = {"Cache-Control": "private, no-store"} if request.auth is not None else {}
        return json_response(document, headers=private)


def _asked(request: Request) -> Answer:
    query = request.query_params
    application = query.get("application") or None
    texts = {name: query.get(name, "").strip() for name in ("model", "gpu", "soc", "backend")}
    for name, text in texts.items():
        if len(text) > LONGEST:
            raise Problem("invalid_filter", f"{name}: at most {LONGEST} characters", field=name)
    if texts["backend"] not in ("", *BACKENDS):
        known = ", ".join(BACKENDS)
        raise Problem("invalid_filter", f"backend={texts['backend']:.20}: give {known}", field="backend")
    question = Question(**texts, simulated=query.get("simulated") == "1")
    try:
        if request.auth is not None and question.anything:
            own = selectors.of_installation(installation_of_request(request), application)
            if own is None:
                raise not_found("this installation has measured nothing of this front yet")
            return own
        return selectors.ask(question, application)
    except (selectors.NoFrontError, selectors.UnknownDeviceError) as error:
        raise not_found(str(error)) from error


def _positive(request: Request, name: str) -> float:
    text = request.query_params[name]
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise Problem("invalid_filter", f"{name}={text:.20}: give a number above 0", field=name)
    return value
