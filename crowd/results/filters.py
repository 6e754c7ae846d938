"""Which speedups to show: the same filters in every address of pages and API."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from datetime import date
from typing import Any

from crowd.fronts.selectors import BEST

ALL = "all"
WHOLE_NUMBER = re.compile(r"[0-9]{1,7}")
MOST = 1_000_000
PARSED = frozenset({"since", "min_sessions"})


class InvalidFilterError(ValueError):
    """A filter that cannot be understood. `name` is the parameter, the message says what would be right."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(message)
        self.name = name


@dataclass(frozen=True)
class SpeedupFilters:
    """What to show. Empty text means no restriction; texts match anywhere, whatever the case."""

    front: str = ""  # slug; empty: the newest front that somebody has measured
    application: str = "kfusion"
    configuration: str = BEST  # ALL for every configuration
    soc: str = ""
    gpu: str = ""
    os: str = ""
    backend: str = ""
    since: date | None = None  # only sessions measured on or after that day (UTC)
    min_sessions: int = 1

    @classmethod
    def parse(cls, query: Mapping[str, str]) -> "SpeedupFilters":
        """Filters of a query string; absent and empty ones are the defaults. Raises InvalidFilterError."""
        given = {f.name: query[f.name].strip() for f in fields(cls) if query.get(f.name, "").strip()}
        texts: dict[str, Any] = {name: text for name, text in given.items() if name not in PARSED}
        filters = cls(**texts)
        if "since" in given:
            try:
                filters = replace(filters, since=date.fromisoformat(given["since"]))
            except ValueError:
                raise InvalidFilterError(
                    "since", f"since={given['since']:.50}: give a day as 2026-11-30"
                ) from None
        if "min_sessions" in given:
            if (
                not WHOLE_NUMBER.fullmatch(given["min_sessions"])
                or not 1 <= int(given["min_sessions"]) <= MOST
            ):
                raise InvalidFilterError(
                    "min_sessions",
                    f"min_sessions={given['min_sessions']:.50}: give a whole number from 1 to 1000000",
                )
            filters = replace(filters, min_sessions=int(given["min_sessions"]))
        return filters
