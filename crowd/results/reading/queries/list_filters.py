"""Which sessions and runs to list: the filters of their addresses in the API."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from datetime import date
from typing import Self
from uuid import UUID

from crowd.fronts import selectors as published
from crowd.results.reading.queries.filters import read
from crowd.results.reading.queries.parsing import check_application, unknown_front


@dataclass(frozen=True)
class SessionFilters:
    """Which sessions to list. Empty texts and None restrict nothing. The texts of the device mean what they
    mean in SpeedupFilters: they see what the public sees.
    """

    application: str = ""
    front: str = ""
    configuration: str = ""  # only sessions with an answer for it
    device: str = ""
    vendor: str = ""
    soc: str = ""
    gpu: str = ""
    os: str = ""
    backend: str = ""
    since: date | None = None
    until: date | None = None
    valid: bool | None = None  # whether an answer (for `configuration`) is valid, or one is not
    confirmed: bool | None = None  # whether the figure (of `configuration`, else best) is confirmed
    simulated: bool = False

    @classmethod
    def parse(cls, query: Mapping[str, str]) -> Self:
        """The filters of QUERY; absent and empty ones restrict nothing. One query at most.

        Raises InvalidFilterError, UnknownFrontError.
        """
        filters = cls(**read([f.name for f in fields(cls)], query))
        return filters._published() if filters.front or filters.application else filters

    def _published(self) -> Self:
        """The same, with the application of the front. Raises UnknownFrontError, InvalidFilterError."""
        applications = dict(published.names())
        if not self.front:
            if self.application not in applications.values():
                raise unknown_front("application", self.application, applications.values())
            return self
        if self.front not in applications:
            raise unknown_front("front", self.front, applications)
        own = applications[self.front]
        check_application(self.front, own, self.application)
        return replace(self, application=own)


@dataclass(frozen=True)
class RunFilters(SessionFilters):
    """Which runs to list: the filters of their sessions. `configuration` and `valid` are those of the run."""

    session: UUID | None = None
