"""The API's addresses that anybody may read of figures: speedups, devices, comparisons."""

from django.http import HttpResponse
from drf_spectacular.utils import OpenApiParameter, extend_schema
from rest_framework.request import Request

from crowd.http.api import Endpoint, answer, page, refuse_unknown
from crowd.http.descriptions import PAGING
from crowd.http.problems import Problem, not_found
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
from crowd.results.reading import selectors
from crowd.results.reading.queries.filters import MOST, SpeedupFilters
from crowd.results.reading.rows import DeviceDetail
from crowd.results.reading.transferring import correlations

MOST_COMPARED = 6


class SpeedupsView(Endpoint):
    """The crowd's figures."""

    @extend_schema(
        operation_id="speedups",
        summary="Speedup of a configuration over the default on each device, fastest first",
        description=(
            "A speedup is a ratio of times on one device with one backend and processor. low and high are a "
            "95 % interval over independent installations, null below three of them. The summary rests on "
            "confirmed figures: a random-effects mean over device models. A model counts once: with its GPU "
            "before its CPU, and natively before in a browser."
        ),
        parameters=[
            OpenApiParameter("front", TEXT, description="version; the newest measured one where absent"),
            OpenApiParameter("application", TEXT, description="that of `front`, else kfusion where absent"),
            OpenApiParameter("configuration", TEXT, description="best where absent; all for every one"),
            *DEVICE,
            *PERIOD,
            OpenApiParameter("min_sessions", {"type": "integer", "minimum": 1, "maximum": MOST}),
            OpenApiParameter(
                "suspect", SWITCH, description="0 leaves out figures that come from suspect sessions alone"
            ),
            SIMULATED,
            *PAGING,
        ],
        responses={200: answers.SpeedupPage},
    )
    def get(self, request: Request) -> HttpResponse:
        refuse_unknown(request, *names_of(SpeedupFilters), *PAGE_PARAMETERS)
        found = selectors.speedups(_filters(request))
        rows = page(request, found.rows, lambda row: row.key, answers.speedup)
        return answer({"front": found.front, **rows, "summary": answers.crowd(found.headline, found.fared)})


class DevicesView(Endpoint):
    """Every device model that somebody measured."""

    @extend_schema(
        operation_id="devices",
        summary="Measured devices, fastest first",
        description="`/speedups` takes more filters.",
        parameters=[
            OpenApiParameter("application", TEXT, description="whose speedups; kfusion where absent"),
            SIMULATED,
            *PAGING,
        ],
        responses={200: answers.DevicePage},
    )
    def get(self, request: Request) -> HttpResponse:
        refuse_unknown(request, "application", "simulated", *PAGE_PARAMETERS)
        filters = _filters(request)
        rows = selectors.devices(filters.simulated, filters.application)
        return answer(page(request, rows, lambda row: row.device.slug, answers.device))


class DeviceView(Endpoint):
    """One device model."""

    @extend_schema(
        operation_id="device",
        summary="One device: every configuration, the newest sessions",
        responses={200: answers.DeviceDetailAnswer},
    )
    def get(self, request: Request, slug: str) -> HttpResponse:  # noqa: ARG002
        return answer(_detail(slug))


class CompareView(Endpoint):
    """Devices side by side."""

    @extend_schema(
        operation_id="compare",
        summary="Devices side by side",
        parameters=[OpenApiParameter("devices", str, required=True, description="2 to 6 slugs: a,b")],
        responses={200: answers.Comparison},
    )
    def get(self, request: Request) -> HttpResponse:
        slugs = list(dict.fromkeys(filter(None, request.query_params.get("devices", "").split(","))))
        if not 2 <= len(slugs) <= MOST_COMPARED:
            detail = f"devices={','.join(slugs)}: name 2 to {MOST_COMPARED} devices, as devices=a,b"
            raise Problem(400, "invalid_filter", detail, field="devices")
        results = [_detail(slug) for slug in slugs]
        if len({result.simulated for result in results}) > 1:
            detail = f"devices={','.join(slugs)}: some are simulated; compare them with each other alone"
            raise Problem(400, "invalid_filter", detail, field="devices")
        found = [answers.correlated(row) for row in correlations.between(slugs)]
        return answer({"results": results, "correlations": found})


def _filters(request: Request) -> SpeedupFilters:
    return understood(selectors.asked, request)


def _detail(slug: str) -> answers.DeviceDetailAnswer:
    found: DeviceDetail | None = selectors.device(slug)
    if found is None:
        raise not_found(f"no device {slug!r}: GET /api/v1/devices lists them")
    return answers.device_detail(
        found.device, found.session_count, found.installations, found.speedups, found.sessions
    )
