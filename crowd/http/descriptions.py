"""Parts of the OpenAPI document that views share."""

from drf_spectacular.openapi import AutoSchema
from drf_spectacular.utils import OpenApiParameter

from crowd.http.api import DEFAULT_LIMIT, MAX_LIMIT

PAGINATION = [
    OpenApiParameter(
        "limit",
        {"type": "integer", "minimum": 1, "maximum": MAX_LIMIT, "default": DEFAULT_LIMIT},
        description="rows of a page",
    ),
    OpenApiParameter("cursor", str, description="where the page starts, from `next` of the page before"),
]


class ExplicitSchema(AutoSchema):
    """Takes descriptions from extend_schema only, never from a view's docstring."""

    def get_description(self) -> str:  # type: ignore[override] # as drf-spectacular has it
        return ""
