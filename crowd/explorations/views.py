"""Public endpoints of explorations, and leases for machines that measure over HTTP."""

from django.http import HttpResponse, HttpResponseBase
from django.utils.cache import get_conditional_response
from django.utils.http import quote_etag
from drf_spectacular.utils import extend_schema
from rest_framework.request import Request

from crowd.explorations import lease_api, responses, selectors
from crowd.explorations.measuring.authentication import DeviceEndpoint, authenticated_device
from crowd.explorations.outcomes import watching
from crowd.http.api import Endpoint, has_body, json_response, paginate, public_json, read_body
from crowd.http.descriptions import PAGINATION
from crowd.http.problems import not_found
from wire.lease import Held, Lease, LeaseRequest, Result, Stored

RETRY_SECONDS = 5


class ExplorationsView(Endpoint):
    """All explorations."""

    @extend_schema(
        operation_id="explorations",
        summary="Explorations and their progress, newest first",
        parameters=PAGINATION,
        responses={200: responses.ExplorationPage},
    )
    def get(self, request: Request) -> HttpResponseBase:
        rows = selectors.explorations()
        page = paginate(request, rows, lambda row: str(row.exploration.pk), responses.summary)
        return public_json(request, page)


class ExplorationView(Endpoint):
    """One exploration in full."""

    @extend_schema(
        operation_id="exploration",
        summary="One exploration: its measurements and its front",
        description="Measurements come in pages. With If-None-Match, an unchanged page is answered with 304.",
        parameters=PAGINATION,
        responses={200: responses.ExplorationDetail, 304: None},
    )
    def get(self, request: Request, key: int) -> HttpResponseBase:
        seen = watching.watch(key)
        if seen is None:
            raise not_found(f"no exploration {key}: GET /api/v1/explorations lists them")
        etag = quote_etag(seen.version)
        if (unchanged := get_conditional_response(request._request, etag=etag)) is not None:
            return unchanged
        part = paginate(request, selectors.numbers(seen.exploration), str, int)
        rows = selectors.evaluations(seen.exploration, part["results"])
        front = watching.results_of(seen).front
        detail = responses.detail(selectors.progress_from_status(seen), front, rows, part["next"])
        return public_json(request, detail, etag)


class LeasesView(DeviceEndpoint):
    """Work for a reference device."""

    @extend_schema(
        operation_id="lease",
        summary="Take an evaluation to measure",
        description="204 if none waits for this device, or if all its machines are busy: ask again later.",
        request={"application/json": LeaseRequest},
        responses={201: Lease, 204: None},
    )
    def post(self, request: Request) -> HttpResponse:
        body = read_body(request) if has_body(request._request) else b""
        lease = lease_api.begin_lease(authenticated_device(request), body)
        if lease is None:
            return HttpResponse(status=204, headers={"Retry-After": str(RETRY_SECONDS)})
        return json_response(lease, 201, {"Cache-Control": "no-store"})


class HeartbeatView(DeviceEndpoint):
    """Renews a lease."""

    @extend_schema(
        operation_id="heartbeat",
        summary="Renew a lease",
        description="410 if it is gone: stop measuring, another machine may have the evaluation.",
        request=None,
        responses={200: Held},
    )
    def post(self, request: Request, key: int, attempt: int) -> HttpResponse:
        return json_response(lease_api.renew_lease(authenticated_device(request), key, attempt))


class ResultView(DeviceEndpoint):
    """The result of a measurement."""

    @extend_schema(
        operation_id="result",
        summary="Send a result or a failure, or return the evaluation",
        description="410 if the lease is gone. The same result sent again gets the same response.",
        request={"application/json": Result},
        responses={200: Stored},
    )
    def post(self, request: Request, key: int, attempt: int) -> HttpResponse:
        return json_response(
            lease_api.finish_lease(authenticated_device(request), key, attempt, read_body(request))
        )
