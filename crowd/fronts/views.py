"""The manifest, fronts, and the content-addressed files that they refer to."""

from collections.abc import Callable

from django.http import (
    FileResponse,
    Http404,
    HttpRequest,
    HttpResponse,
    HttpResponseBase,
    HttpResponseNotModified,
)
from django.utils.cache import get_conditional_response
from django.views.decorators.http import require_safe
from drf_spectacular.utils import extend_schema
from rest_framework.request import Request

from crowd.fronts import intake_policy, manifests, responses, selectors, sequences, trajectories
from crowd.fronts.content import plans
from crowd.http.api import Endpoint, paginate, public_json
from crowd.http.descriptions import PAGINATION
from crowd.http.problems import Problem, not_found
from slam.kfusion.definition import VECTORS

A_DAY = 24 * 3600
A_YEAR = 365 * A_DAY


class ManifestView(Endpoint):
    """The manifest for all clients; crowd.predictions extends it with assignments to one client."""

    def get(self, request: Request) -> HttpResponseBase:
        application = request.query_params.get("application") or None
        try:
            manifest = manifests.current(application, intake_policy.current())
        except manifests.OutdatedFrontError as error:
            raise Problem("front_outdated", str(error)) from error
        if manifest is None:
            what = "no front" if application is None else f"no front of {application!r:.60}"
            raise Problem("no_front", f"{what} is published here", field="application")
        full = HttpResponse(manifest.content, content_type="application/json")
        response = get_conditional_response(request._request, etag=manifest.etag, response=full) or full
        response["ETag"] = manifest.etag
        response["Cache-Control"] = "public, no-cache"
        return response


class FrontsView(Endpoint):
    """All released fronts."""

    @extend_schema(
        operation_id="fronts",
        summary="Published fronts, newest first",
        parameters=PAGINATION,
        responses={200: responses.FrontPage},
    )
    def get(self, request: Request) -> HttpResponseBase:
        rows = selectors.fronts()
        return public_json(request, paginate(request, rows, lambda front: front.slug, responses.summary))


class FrontView(Endpoint):
    """One front with all its members."""

    @extend_schema(
        operation_id="front",
        summary="One front: its points, protocol, sequence, provenance",
        responses={200: responses.FrontDetail},
    )
    def get(self, request: Request, version: str) -> HttpResponseBase:
        front = selectors.front(version)
        if front is None:
            raise not_found(f"no front {version!r}: GET /api/v1/fronts lists them")
        return public_json(request, responses.detail(front))


@require_safe
def chunk(request: HttpRequest, sha256: str) -> HttpResponseBase:
    """A chunk of a sequence by its digest."""
    return _by_digest(request, sha256, _chunk)


@require_safe
def trajectory(request: HttpRequest, sha256: str) -> HttpResponseBase:
    """A reference trajectory by its digest."""
    return _by_digest(request, sha256, _json(trajectories.find_released))


@require_safe
def plan(request: HttpRequest, sha256: str) -> HttpResponseBase:
    """A frame plan by its digest."""
    return _by_digest(request, sha256, _json(plans.find))


@require_safe
def shaders(request: HttpRequest, sha256: str) -> HttpResponseBase:
    """The shaders of a plan by their digest."""
    return _by_digest(request, sha256, _json(plans.find_shaders))


@require_safe
def module(request: HttpRequest, sha256: str) -> HttpResponseBase:
    """The WebAssembly module by its digest."""
    return _by_digest(request, sha256, _module)


@require_safe
def vectors(_request: HttpRequest) -> HttpResponseBase:
    """The golden vectors of KinectFusion's kernels, for authors of other executors."""
    response = FileResponse(VECTORS.open("rb"), content_type="application/gzip")
    response["Cache-Control"] = f"public, max-age={A_DAY}"
    return response


def _by_digest(
    request: HttpRequest, sha256: str, find: Callable[[str], HttpResponseBase | None]
) -> HttpResponseBase:
    """The answer of `find` for SHA256, cacheable forever. Raises Http404 for None."""
    etag = f'"{sha256}"'
    if request.headers.get("If-None-Match") == etag:
        return HttpResponseNotModified()
    response = find(sha256)
    if response is None:
        raise Http404(f"nothing here has the digest {sha256}")
    response["ETag"] = etag
    response["Cache-Control"] = f"public, max-age={A_YEAR}, immutable"
    return response


def _chunk(sha256: str) -> HttpResponseBase | None:
    chunk = sequences.open_chunk(sha256)
    return None if chunk is None else FileResponse(chunk, content_type="application/octet-stream")


def _module(sha256: str) -> HttpResponseBase | None:
    content = plans.find_module(sha256)
    return None if content is None else HttpResponse(content, content_type="application/wasm")


def _json(find: Callable[[str], str | None]) -> Callable[[str], HttpResponseBase | None]:
    def respond(sha256: str) -> HttpResponseBase | None:
        content = find(sha256)
        return None if content is None else HttpResponse(content, content_type="application/json")

    return respond
