"""Query parameters that several lists of results take: how they are described and read."""

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any, TypeVar

from drf_spectacular.types import OpenApiTypes
from drf_spectacular.utils import OpenApiParameter
from rest_framework.request import Request

from crowd.devices.naming.vendors import VENDORS
from crowd.http.problems import Problem
from crowd.results.reading.backends import BACKENDS
from crowd.results.reading.queries.filters import LONGEST, MOST_WORDS, InvalidFilterError
from crowd.results.reading.queries.parsing import UnknownFrontError

T = TypeVar("T")
PAGE_PARAMETERS = ("limit", "cursor")
TEXT = {"type": "string", "maxLength": LONGEST}
SWITCH = {"type": "string", "enum": ["0", "1"]}
MATCHED = "matches anywhere, whatever the case; in quotation marks, as a whole"

SIMULATED = OpenApiParameter(
    "simulated", SWITCH, description="1 shows simulated devices, and none that anybody has; 0 where absent"
)
# What a device and its chip decide.
DEVICE = [
    OpenApiParameter(
        "device",
        TEXT,
        description=f"at most {MOST_WORDS} different words, each of which is in its maker or name",
    ),
    OpenApiParameter(
        "vendor", str, enum=list(VENDORS), description="whose chip computed; CPU: the processor did"
    ),
    OpenApiParameter("soc", TEXT, description=f"system on a chip: {MATCHED}"),
    OpenApiParameter("gpu", TEXT, description=f"graphics chip: {MATCHED}"),
    OpenApiParameter("os", TEXT, description=f"operating system: {MATCHED}"),
    OpenApiParameter("backend", str, enum=list(BACKENDS), description="with what it was measured"),
]
PERIOD = [
    OpenApiParameter(
        "since", OpenApiTypes.DATE, description="a day, as 2026-11-30: only sessions from then on"
    ),
    OpenApiParameter("until", OpenApiTypes.DATE, description="a day: only sessions up to its end (UTC)"),
]


def names_of(filters: type[Any]) -> list[str]:
    """The parameters that FILTERS, a dataclass, read."""
    return [field.name for field in fields(filters)]


def understood(read: Callable[[Mapping[str, str]], T], request: Request) -> T:
    """What READ makes of the query of REQUEST. Raises Problem 400 for a filter that cannot be understood, 404
    for a front that was never published.
    """
    try:
        return read(request.query_params)
    except UnknownFrontError as error:
        raise Problem(404, "not_found", str(error), field=error.name) from error
    except InvalidFilterError as error:
        raise Problem(400, "invalid_filter", str(error), field=error.name) from error
