"""What a query string asks for, of the fronts and applications that there are."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from crowd.fronts import selectors as published
from crowd.results.reading.queries.filters import InvalidFilterError, SpeedupFilters

NAMED = 20  # so many names are told at most


class UnknownFrontError(InvalidFilterError):
    """A front, or an application's, that was never published here; the message lists those that were."""


def asked(query: Mapping[str, str], names: Sequence[tuple[str, str]] | None = None) -> SpeedupFilters:
    """The filters of QUERY, of one application: that of the front it names, else the one it names.

    NAMES are all fronts with their applications, newest first, where the caller has them: then, where QUERY
    names neither, it is the default one, or the one published first where that has none. One query at most.

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
    own = applications[front]
    check_application(front, own, named)
    return own


def check_application(front: str, own: str, named: str) -> None:
    """Raises InvalidFilterError where NAMED is not OWN, the application of FRONT."""
    if named not in ("", own):
        raise InvalidFilterError("front", f"front={front} is one of {own}, not of {named}: name either alone")


def unknown_front(name: str, given: str, known: Iterable[str]) -> UnknownFrontError:
    """The error for the filter NAME, whose value GIVEN is not one of those KNOWN."""
    there = list(dict.fromkeys(known))
    right = f"give one of {', '.join(there[:NAMED])}" if there else "nothing has been published yet"
    return UnknownFrontError(name, f"{name}={given:.50}: {right}")
