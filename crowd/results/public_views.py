"""The API's addresses that anybody may read: speedups, devices, comparisons."""

from django.http import HttpResponse
from drf_spectacular.types import OpenApiTypes
from drf_spectacular.utils import OpenApiParameter, extend_schema
from rest_framework.request import Request

from crowd.api import Endpoint, answer, page
from crowd.descriptions import PAGING
from crowd.problems import Problem, not_found
from crowd.results import answers, correlations, selectors
from crowd.results.filters import MOST, InvalidFilterError, SpeedupFilters
from crowd.results.rows import DeviceDetail

MOST_COMPARED = 6


class SpeedupsView(Endpoint):
    """The crowd's figures."""

    @extend_schema(
        operation_id="speedups",
        summary="Speedup of a configuration over the default on each device, fastest first",
        description=(
            "A speedup is a ratio of times on one device with one backend and processor. low and high are a "
            "95 % interval over installations, null below three of them. The summary is over device models: "
            "an unweighted geometric mean."
        ),
        parameters=[
            OpenApiParameter("front", str, description="version; the newest measured one where absent"),
            OpenApiParameter("application", str, description="kfusion where absent"),
            OpenApiParameter("configuration", str, description="best where absent; all for every one"),
            OpenApiParameter("soc", str),
            OpenApiParameter("gpu", str),
            OpenApiParameter("os", str),
            OpenApiParameter("backend", str),
            OpenApiParameter(
                "since", OpenApiTypes.DATE, description="a day, as 2026-11-30: only sessions from then on"
            ),
            OpenApiParameter("min_sessions", {"type": "integer", "minimum": 1, "maximum": MOST}),
            *PAGING,
        ],
        responses={200: answers.SpeedupPage},
    )
    def get(self, request: Request) -> HttpResponse:
        try:
            filters = SpeedupFilters.parse(request.query_params)
        except InvalidFilterError as error:
            raise Problem(400, "invalid_filter", str(error), field=error.name) from error
        found = selectors.speedups(filters)
        rows = page(request, found.rows, lambda row: row.key, answers.speedup)
        return answer({"front": found.front, **rows, "summary": answers.crowd(found.headline)})


class DevicesView(Endpoint):
    """Every device model that somebody measured."""

    @extend_schema(
        operation_id="devices",
        summary="Measured devices, fastest first",
        parameters=PAGING,
        responses={200: answers.DevicePage},
    )
    def get(self, request: Request) -> HttpResponse:
        return answer(page(request, selectors.devices(), lambda row: row.device.slug, answers.device))


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
        found = [answers.correlated(row) for row in correlations.between(slugs)]
        return answer({"results": results, "correlations": found})


def _detail(slug: str) -> answers.DeviceDetailAnswer:
    found: DeviceDetail | None = selectors.device(slug)
    if found is None:
        raise not_found(f"no device {slug!r}: GET /api/v1/devices lists them")
    return answers.device_detail(
        found.device, found.session_count, found.installations, found.speedups, found.sessions
    )
