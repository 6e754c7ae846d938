"""Query parameters that several lists of results share: their descriptions and parsing."""

from collections.abc import Callable, Mapping
from typing import TypeVar

from drf_spectacular.types import OpenApiTypes
from drf_spectacular.utils import OpenApiParameter
from rest_framework.request import Request

from crowd.devices.naming.chips import VENDORS
from crowd.http.problems import Problem
from crowd.results.reading.backends import BACKENDS
from crowd.results.reading.queries.filters import MAX_TEXT, MAX_WORDS, InvalidFilterError
from crowd.results.reading.queries.parsing import UnknownFrontError

T = TypeVar("T")
PAGE_PARAMETERS = ("limit", "cursor")
TEXT = {"type": "string", "maxLength": MAX_TEXT}
SWITCH = {"type": "string", "enum": ["0", "1"]}
MATCHED = "matches a substring, in any case; in quotation marks, the whole text"

SIMULATED_PARAMETER = OpenApiParameter(
    "simulated", SWITCH, description="1: nothing, except on a demo server; 0: nothing on a demo server"
)
# Filters on a device and its chip.
DEVICE_PARAMETERS = [
    OpenApiParameter(
        "device",
        TEXT,
        description=f"at most {MAX_WORDS} different words, each contained in maker or name",
    ),
    OpenApiParameter(
        "vendor", str, enum=list(VENDORS), description="maker of the chip that computed; CPU: the processor"
    ),
    OpenApiParameter("soc", TEXT, description=f"system on a chip: {MATCHED}"),
    OpenApiParameter("gpu", TEXT, description=f"graphics chip: {MATCHED}"),
    OpenApiParameter("os", TEXT, description=f"operating system: {MATCHED}"),
    OpenApiParameter("backend", str, enum=list(BACKENDS), description="the backend that measured"),
]
PERIOD_PARAMETERS = [
    OpenApiParameter(
        "since",
        OpenApiTypes.DATE,
        description="a day, such as 2026-11-30: only sessions from its start (UTC)",
    ),
    OpenApiParameter("until", OpenApiTypes.DATE, description="a day: only sessions up to its end (UTC)"),
]


def parse_query(read: Callable[[Mapping[str, str]], T], request: Request) -> T:
    """The query of `request`, parsed by `read`.

    Raises Problem 400 for an invalid filter, 404 for an unknown front.
    """
    try:
        return read(request.query_params)
    except UnknownFrontError as error:
        raise Problem("not_found", str(error), field=error.name) from error
    except InvalidFilterError as error:
        raise Problem("invalid_filter", str(error), field=error.name) from error
