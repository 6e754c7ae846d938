"""The OpenAPI document. Its schemas come from the structs that read and write the JSON."""

import re
from collections.abc import Iterable
from functools import cache
from typing import Any

import msgspec
from django.conf import settings
from django.http import HttpResponseBase
from drf_spectacular.extensions import OpenApiSerializerExtension
from drf_spectacular.generators import SchemaGenerator
from drf_spectacular.utils import extend_schema
from rest_framework.request import Request

from crowd.api_pages import examples
from crowd.http.api import Endpoint, public_json

TEMPLATE = "#/components/schemas/{name}"
PROBLEM = {
    "type": "object",
    "description": "RFC 9457: a stable code, what is wrong and where.",
    "required": ["type", "title", "status", "code", "detail"],
    "properties": {
        "type": {"type": "string", "format": "uri-reference", "description": "where the code is documented"},
        "title": {"type": "string"},
        "status": {"type": "integer"},
        "code": {"type": "string", "pattern": "^[a-z][a-z0-9_]*$"},
        "detail": {"type": "string"},
        "field": {"type": "string", "description": "the member, parameter or header that is wrong"},
        "request_id": {"type": "string", "description": "names the request in the server's log"},
        "minimum_app_version": {"type": "string", "description": "with the code app_outdated"},
        "items": {"type": "array", "items": {"$ref": "#/components/schemas/Item"}},
    },
}

# Header fields of every answer of a limited address.
HEADERS = {
    "RateLimit-Policy": 'The limit: "name";q=requests;w=seconds',
    "RateLimit": 'The rest of the limit: "name";r=requests;t=seconds until it is reset',
}

UNCHANGED = "Unchanged: If-None-Match names the ETag"
# The structs that views name; `complete` adds the structs nested in them.
_described: set[type[msgspec.Struct]] = set()


class StructExtension(OpenApiSerializerExtension):
    """Lets drf-spectacular describe msgspec structs."""

    target_class = "msgspec.Struct"
    match_subclasses = True

    def get_name(self, auto_schema: Any, direction: Any) -> str:  # noqa: ARG002
        return str(self.target.__name__)

    def map_serializer(self, auto_schema: Any, direction: Any) -> Any:  # noqa: ARG002
        _described.add(self.target)
        return _components([self.target])[self.target.__name__]


def _components(structs: Iterable[type[msgspec.Struct]]) -> dict[str, Any]:
    """The JSON schemas of `structs` and of all structs nested in them, by name."""
    _, schemas = msgspec.json.schema_components(structs, ref_template=TEMPLATE)
    return dict(schemas)


def complete(result: dict[str, Any], **_: Any) -> dict[str, Any]:
    """Add what views do not declare: nested structs, and the error answer of every call."""
    schemas = result["components"]["schemas"]
    schemas.update(_components(_described))
    schemas["Problem"] = PROBLEM
    # By name: structs are found in another order in each process.
    result["components"]["schemas"] = dict(sorted(schemas.items()))
    result["components"]["headers"] = {
        name: {"description": text, "schema": {"type": "string"}} for name, text in HEADERS.items()
    }
    limit_headers = {name: {"$ref": f"#/components/headers/{name}"} for name in HEADERS}
    retry_after = {"description": "seconds to wait, with 429 and 503", "schema": {"type": "integer"}}
    error = {
        "description": "Error",
        "headers": {**limit_headers, "Retry-After": retry_after},
        "content": {"application/problem+json": {"schema": {"$ref": TEMPLATE.format(name="Problem")}}},
    }
    for path, operations in result["paths"].items():
        # What pages of other origins may read has an ETag.
        if "get" in operations and re.match(settings.CORS_URLS_REGEX, path):
            operations["get"]["responses"].setdefault("304", {"description": UNCHANGED})
        for operation in operations.values():
            for response in operation["responses"].values():
                response.setdefault("headers", limit_headers)
            operation["responses"].setdefault("default", error)
    examples.describe(result)
    return result


@cache
def document() -> dict[str, Any]:
    """The OpenAPI 3.1 document of the whole API, built once per process."""
    generator = SchemaGenerator()
    described: dict[str, Any] = generator.get_schema(request=None, public=True)
    return described


class OpenApiView(Endpoint):
    """Serves the OpenAPI document."""

    @extend_schema(exclude=True)
    def get(self, request: Request) -> HttpResponseBase:
        return public_json(request, document())
