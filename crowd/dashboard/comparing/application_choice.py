"""Choice of the application of a page about devices. Figures of two applications are never compared."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from urllib.parse import urlencode

from django.http import Http404

from crowd.dashboard.comparing.comparison import InvalidComparisonError
from crowd.dashboard.responses import or_404
from crowd.fronts import selectors as published
from crowd.fronts.selectors import DEFAULT_APPLICATION
from crowd.results.reading import selectors as results
from crowd.results.reading.rows import DeviceDetail


@dataclass(frozen=True)
class MeasuredDevice:
    """A device measured with `application`, and all `applications` that it was measured with.

    `next_query` keeps the application in links to other pages.
    """

    detail: DeviceDetail
    application: str
    applications: tuple[str, ...]
    next_query: str


def measured_device(slug: str, application: str = "") -> MeasuredDevice:
    """The device `slug` with `application`, by default that of its newest session.

    Raises Http404 if there is no such device, or if it was not measured with `application`.
    """
    detail = or_404(results.device(slug))
    names = published.names()
    of_front = dict(names)
    fronts = [row.front for row in detail.sessions] + [row.front for row in detail.speedups]
    applications = tuple(dict.fromkeys(of_front[front] for front in fronts))
    chosen = application or applications[0]
    if chosen not in applications:
        raise Http404
    if len(applications) > 1:
        detail = or_404(results.device(slug, chosen))
    return MeasuredDevice(detail, chosen, applications, next_query(chosen, names))


def measured_devices(slugs: Sequence[str], application: str = "") -> list[MeasuredDevice]:
    """The devices `slugs` with `application`, by default the first common one of the first device.

    `applications` are the common ones. Raises Http404 as `measured_device`, and InvalidComparisonError if
    there is no common application.
    """
    each = [measured_device(slug, application) for slug in slugs]
    shared = tuple(name for name in each[0].applications if all(name in one.applications for one in each))
    if not shared:
        raise InvalidComparisonError("no application was measured on all of these devices")
    chosen = application or shared[0]
    devices = [
        one if one.application == chosen else measured_device(one.detail.device.slug, chosen) for one in each
    ]
    return [replace(one, applications=shared) for one in devices]


def next_query(application: str, names: Sequence[tuple[str, str]]) -> str:
    """The query that keeps `application` in links to devices; "" if all fronts have one application.

    `names` are all fronts, each with its application.
    """
    several = len({name for _, name in names}) > 1
    return f"?{urlencode({'application': application})}" if several else ""


def application_option(application: str) -> str:
    """The value of a client's option --application; "" for the default."""
    return application if application != DEFAULT_APPLICATION else ""


def application_query(shown: MeasuredDevice) -> str:
    """The query for the application of `shown`; "" if the device has only one."""
    return urlencode({"application": shown.application}) if len(shown.applications) > 1 else ""
