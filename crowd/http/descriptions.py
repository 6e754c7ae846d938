"""How views describe themselves in the OpenAPI document."""

from drf_spectacular.openapi import AutoSchema
from drf_spectacular.utils import OpenApiParameter

from crowd.http.api import LONGEST_PAGE, PAGE

PAGING = [
    OpenApiParameter(
        "limit",
        {"type": "integer", "minimum": 1, "maximum": LONGEST_PAGE, "default": PAGE},
        description="rows of a page",
    ),
    OpenApiParameter("cursor", str, description="where the page starts: as `next` of the one before says"),
]


class ExplicitSchema(AutoSchema):
    """Takes descriptions from extend_schema alone: a view's docstring is for those who read the code."""

    def get_description(self) -> str:  # type: ignore[override] # as drf-spectacular has it
        return ""
