"""Parses filters of a query string against the published fronts and applications."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from crowd.fronts import selectors as published
from crowd.results.reading.queries.filters import InvalidFilterError, SpeedupFilters

MAX_NAMES = 20  # in a message


class UnknownFrontError(InvalidFilterError):
    """The front or application was never published here. The message lists those that were."""


def parse_filters(query: Mapping[str, str], names: Sequence[tuple[str, str]] | None = None) -> SpeedupFilters:
    """The filters of `query` for one application: that of its front, else the one that it names.

    `names`: all fronts with their applications, newest first, if the caller has them. With `names`, the
    application of a `query` without either is the default one or, if that has no front, the first that was
    published. At most one query.

    Raises InvalidFilterError, UnknownFrontError.
    """
    filters = SpeedupFilters.parse(query)
    named = query.get("application", "").strip()
    if names is None:
        if not (filters.front or named):
            return filters
        names = published.names()
    applications = dict(names)
    if filters.front:
        return replace(filters, application=_application_of(filters.front, named, applications))
    if filters.application in applications.values() or not (named or applications):
        return filters
    if named:
        raise unknown_front("application", named, applications.values())
    return replace(filters, application=names[-1][1])


def _application_of(front: str, named: str, applications: Mapping[str, str]) -> str:
    if front not in applications:
        raise unknown_front("front", front, applications)
    application = applications[front]
    check_application(front, application, named)
    return application


def check_application(front: str, own: str, named: str) -> None:
    """Raises InvalidFilterError if `named` is not `own`, the application of `front`."""
    if named not in ("", own):
        raise InvalidFilterError("front", f"front={front} is of {own}, not of {named}: give one of the two")


def unknown_front(name: str, given: str, known: Iterable[str]) -> UnknownFrontError:
    """The error for the filter `name`, whose value `given` is not one of `known`."""
    there = list(dict.fromkeys(known))
    right = f"give one of {', '.join(there[:MAX_NAMES])}" if there else "no front has been published yet"
    return UnknownFrontError(name, f"{name}={given:.50}: {right}")
