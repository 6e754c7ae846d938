"""Which application a page about devices speaks of: figures of two are never set beside each other."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from urllib.parse import urlencode

from django.http import Http404

from crowd.dashboard.answering import found
from crowd.dashboard.comparing.comparison import InvalidComparisonError
from crowd.fronts import selectors as published
from crowd.fronts.selectors import DEFAULT_APPLICATION
from crowd.results.reading import selectors as results
from crowd.results.reading.rows import DeviceDetail


@dataclass(frozen=True)
class Measured:
    """A device as it was measured with one application, and all `applications` that it was measured with;
    `onward` is what the address of another page needs to go on with it.
    """

    detail: DeviceDetail
    application: str
    applications: tuple[str, ...]
    onward: str


def measured(slug: str, application: str = "") -> Measured:
    """The device SLUG with APPLICATION, by default with that of its newest session.

    Raises Http404 where there is no such device, or it was not measured with that.
    """
    detail = found(results.device(slug))
    names = published.names()
    of_front = dict(names)
    fronts = [row.front for row in detail.sessions] + [row.front for row in detail.speedups]
    known = tuple(dict.fromkeys(of_front[front] for front in fronts))
    chosen = application or known[0]
    if chosen not in known:
        raise Http404
    if len(known) > 1:
        detail = found(results.device(slug, chosen))
    return Measured(detail, chosen, known, onward(chosen, names))


def together(slugs: Sequence[str], application: str = "") -> list[Measured]:
    """The devices SLUGS with APPLICATION, by default with the first that all of them have, in the order of
    the first device; `applications` are those.

    Raises Http404 as `measured`, InvalidComparisonError where they have none in common.
    """
    each = [measured(slug, application) for slug in slugs]
    shared = tuple(name for name in each[0].applications if all(name in one.applications for one in each))
    if not shared:
        raise InvalidComparisonError("no application was measured on all of these devices")
    chosen = application or shared[0]
    alike = [one if one.application == chosen else measured(one.detail.device.slug, chosen) for one in each]
    return [replace(one, applications=shared) for one in alike]


def onward(application: str, names: Sequence[tuple[str, str]]) -> str:
    """What the address of a device or of the list needs to go on with APPLICATION; "" where NAMES, all fronts
    with their applications, are of one alone.
    """
    several = len({name for _, name in names}) > 1
    return f"?{urlencode({'application': application})}" if several else ""


def named(application: str) -> str:
    """APPLICATION, as a client has to name it to measure it; "" where it does so by itself."""
    return application if application != DEFAULT_APPLICATION else ""


def query(shown: Measured) -> str:
    """How the application of SHOWN is asked for; "" where there is no other."""
    return urlencode({"application": shown.application}) if len(shown.applications) > 1 else ""
