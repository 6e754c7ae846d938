"""Explorations, for everybody to read; and work for machines that serve as a reference device over HTTP."""

from django.http import HttpResponse, HttpResponseBase
from django.utils.cache import get_conditional_response
from django.utils.http import quote_etag
from drf_spectacular.utils import extend_schema
from rest_framework.request import Request

from crowd.explorations import lease_api, responses, selectors
from crowd.explorations.measuring.authentication import DeviceEndpoint, device_asking
from crowd.explorations.outcomes import watching
from crowd.http.api import Endpoint, has_body, json_response, paginate, read_body
from crowd.http.descriptions import PAGINATION
from crowd.http.problems import not_found

ASK_AGAIN_SECONDS = 5


class ExplorationsView(Endpoint):
    """Every exploration."""

    @extend_schema(
        operation_id="explorations",
        summary="Explorations and how far they have come, newest first",
        parameters=PAGINATION,
        responses={200: responses.ExplorationPage},
    )
    def get(self, request: Request) -> HttpResponse:
        rows = selectors.explorations()
        return json_response(paginate(request, rows, lambda row: str(row.exploration.pk), responses.summary))


class ExplorationView(Endpoint):
    """One exploration in full."""

    @extend_schema(
        operation_id="exploration",
        summary="One exploration: what was measured and its front",
        description="Measurements come in pages; ask again with If-None-Match: 304 where nothing changed.",
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
        front = watching.found(seen).front
        detail = responses.detail(selectors.progress_of(seen), front, rows, part["next"])
        return json_response(detail, headers={"ETag": etag, "Cache-Control": "public, no-cache"})


class LeasesView(DeviceEndpoint):
    """Work for a reference device."""

    @extend_schema(
        operation_id="lease",
        summary="Take an evaluation to measure",
        description="204 where none waits for this device or all its machines are busy: ask again later.",
        request={"application/json": lease_api.LeaseRequest},
        responses={201: lease_api.Lease, 204: None},
    )
    def post(self, request: Request) -> HttpResponse:
        wish = read_body(request) if has_body(request._request) else b""
        lease = lease_api.begin(device_asking(request), wish)
        if lease is None:
            return HttpResponse(status=204, headers={"Retry-After": str(ASK_AGAIN_SECONDS)})
        return json_response(lease, 201, {"Cache-Control": "no-store"})


class HeartbeatView(DeviceEndpoint):
    """A measurement goes on."""

    @extend_schema(
        operation_id="heartbeat",
        summary="Hold a lease for longer",
        description="410 where it is gone: stop measuring, someone else does.",
        request=None,
        responses={200: lease_api.Held},
    )
    def post(self, request: Request, key: int, attempt: int) -> HttpResponse:
        return json_response(lease_api.renew(device_asking(request), key, attempt))


class ResultView(DeviceEndpoint):
    """A measurement has ended."""

    @extend_schema(
        operation_id="result",
        summary="Tell what was measured, why it failed, or give it back",
        description="410 where the lease is gone. The same result sent again is answered as before.",
        request={"application/json": lease_api.Result},
        responses={200: lease_api.Stored},
    )
    def post(self, request: Request, key: int, attempt: int) -> HttpResponse:
        return json_response(lease_api.finish(device_asking(request), key, attempt, read_body(request)))
