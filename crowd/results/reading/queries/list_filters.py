"""The filters of lists of sessions and runs in the API."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self
from uuid import UUID

from crowd.fronts import selectors as published
from crowd.results.reading.queries.filters import Filters
from crowd.results.reading.queries.parsing import check_application, unknown_front


@dataclass(frozen=True)
class SessionFilters(Filters):
    """Filters of sessions. `configuration`: only sessions that measured it."""

    valid: bool | None = None  # with a valid, or with an invalid, summary (of `configuration`)
    confirmed: bool | None = None  # whether the figure (of `configuration`, else best) is confirmed

    @classmethod
    def parse(cls, query: Mapping[str, str]) -> Self:
        """The filters of `query`; absent and empty ones do not restrict. At most one query.

        Raises InvalidFilterError, UnknownFrontError.
        """
        filters = super().parse(query)
        return filters._published() if filters.front or filters.application else filters

    def _published(self) -> Self:
        """These filters with the application of the front. Raises UnknownFrontError, InvalidFilterError."""
        applications = dict(published.names())
        if not self.front:
            if self.application not in applications.values():
                raise unknown_front("application", self.application, applications.values())
            return self
        if self.front not in applications:
            raise unknown_front("front", self.front, applications)
        application = applications[self.front]
        check_application(self.front, application, self.application)
        return replace(self, application=application)


@dataclass(frozen=True)
class RunFilters(SessionFilters):
    """Filters of runs, by their sessions. `configuration` and `valid` are those of the run."""

    session: UUID | None = None
