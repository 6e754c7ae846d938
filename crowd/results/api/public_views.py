"""Public endpoints of figures: speedups, devices, comparisons."""

from django.http import HttpResponseBase
from drf_spectacular.utils import OpenApiParameter, extend_schema
from rest_framework.request import Request

from crowd.http.api import Endpoint, paginate, public_json, reject_unknown_parameters
from crowd.http.descriptions import PAGINATION
from crowd.http.problems import Problem, not_found
from crowd.results.api import responses
from crowd.results.api.parameters import (
    DEVICE_PARAMETERS,
    PAGE_PARAMETERS,
    PERIOD_PARAMETERS,
    SIMULATED_PARAMETER,
    SWITCH,
    TEXT,
    parse_query,
)
from crowd.results.reading import selectors
from crowd.results.reading.queries.filters import MAX_NUMBER, SpeedupFilters
from crowd.results.reading.rows import DeviceDetail
from crowd.results.reading.transferring import correlations

MAX_COMPARED = 6


class SpeedupsView(Endpoint):
    """The speedups of all devices."""

    @extend_schema(
        operation_id="speedups",
        summary="Speedup of a configuration over the default on each device, fastest first",
        description=(
            "A speedup is a ratio of times on one device with one backend and processor. low and high are a "
            "95 % interval over independent installations, null below three of them. The summary is a "
            "random-effects mean over device models with confirmed figures. A model counts once: its GPU is "
            "preferred to its CPU, and a native backend to a browser."
        ),
        parameters=[
            OpenApiParameter("front", TEXT, description="version; default: the newest measured one"),
            OpenApiParameter("application", TEXT, description="default: that of `front`, else kfusion"),
            OpenApiParameter("configuration", TEXT, description="default: best; all: every configuration"),
            *DEVICE_PARAMETERS,
            *PERIOD_PARAMETERS,
            OpenApiParameter("min_sessions", {"type": "integer", "minimum": 1, "maximum": MAX_NUMBER}),
            OpenApiParameter("suspect", SWITCH, description="0: without figures from suspect sessions only"),
            SIMULATED_PARAMETER,
            *PAGINATION,
        ],
        responses={200: responses.SpeedupPage},
    )
    def get(self, request: Request) -> HttpResponseBase:
        reject_unknown_parameters(request, *SpeedupFilters.names(), *PAGE_PARAMETERS)
        speedups = selectors.speedups(_filters(request))
        rows = paginate(request, speedups.rows, lambda row: row.key, responses.speedup)
        return public_json(
            request,
            {
                "front": speedups.front,
                **rows,
                "summary": responses.crowd(speedups.headline, speedups.outcome_counts),
            },
        )


class DevicesView(Endpoint):
    """All measured device models."""

    @extend_schema(
        operation_id="devices",
        summary="Measured devices, fastest first",
        description="`/speedups` takes more filters.",
        parameters=[
            OpenApiParameter(
                "application", TEXT, description="application of the speedups; default: kfusion"
            ),
            SIMULATED_PARAMETER,
            *PAGINATION,
        ],
        responses={200: responses.DevicePage},
    )
    def get(self, request: Request) -> HttpResponseBase:
        reject_unknown_parameters(request, "application", "simulated", *PAGE_PARAMETERS)
        filters = _filters(request)
        rows = selectors.devices(filters.application) if filters.apply_here else ()
        return public_json(request, paginate(request, rows, lambda row: row.device.slug, responses.device))


class DeviceView(Endpoint):
    """One device model."""

    @extend_schema(
        operation_id="device",
        summary="One device: every configuration, the newest sessions",
        responses={200: responses.DeviceDetailAnswer},
    )
    def get(self, request: Request, slug: str) -> HttpResponseBase:
        return public_json(request, _detail(slug))


class CompareView(Endpoint):
    """Devices side by side."""

    @extend_schema(
        operation_id="compare",
        summary="Devices side by side",
        parameters=[OpenApiParameter("devices", str, required=True, description="2 to 6 slugs: a,b")],
        responses={200: responses.Comparison},
    )
    def get(self, request: Request) -> HttpResponseBase:
        slugs = list(dict.fromkeys(filter(None, request.query_params.get("devices", "").split(","))))
        if not 2 <= len(slugs) <= MAX_COMPARED:
            detail = f"devices={','.join(slugs)}: name 2 to {MAX_COMPARED} devices, as devices=a,b"
            raise Problem("invalid_filter", detail, field="devices")
        results = [_detail(slug) for slug in slugs]
        pairs = [responses.correlated(row) for row in correlations.device_correlations(slugs)]
        return public_json(request, {"results": results, "correlations": pairs})


def _filters(request: Request) -> SpeedupFilters:
    return parse_query(selectors.parse_filters, request)


def _detail(slug: str) -> responses.DeviceDetailAnswer:
    detail: DeviceDetail | None = selectors.device(slug)
    if detail is None:
        raise not_found(f"no device {slug!r}: GET /api/v1/devices lists them")
    return responses.device_detail(
        detail.device, detail.session_count, detail.installations, detail.speedups, detail.sessions
    )
