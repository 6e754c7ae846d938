"""The chart of a front on one device, measured or predicted."""

from django.http import Http404, HttpRequest
from django.urls import reverse

from crowd.dashboard import formats
from crowd.dashboard.comparing.application_choice import measured_device
from crowd.dashboard.content import advice
from crowd.dashboard.content.advice import Advice, AdviceRequest, Limits
from crowd.dashboard.content.points import newest_figure
from crowd.dashboard.drawings.drawing import Drawing, Table
from crowd.dashboard.figures.predictions import device_plane
from crowd.dashboard.responses import or_404
from crowd.predictions.selectors import NoFrontError, NothingConfirmedError, UnknownDeviceError

DEFINITION = (
    "Each configuration of a front on one device: its largest trajectory error and its time a frame, or its "
    "speedup over the default where no time is known. Discs were measured on the device. Rings are "
    "predicted, with their 95 % intervals. Pale: probes, which are not recommended. Square: recommended "
    "within the limits."
)


def read_device(request: HttpRequest, slug: str) -> Advice:
    """The front on the device `slug`. Raises Http404, InvalidFilterError."""
    figure = newest_figure(measured_device(slug, request.GET.get("application", "")).detail)
    try:
        return Advice.of(or_404(advice.for_device(figure)), Limits.of(request.GET))
    except NothingConfirmedError as error:
        raise Http404(str(error)) from error


def read_request(request: HttpRequest) -> Advice:
    """The front on the requested device. Raises Http404, InvalidFilterError."""
    asked = AdviceRequest.of(request.GET)
    try:
        return Advice.of(advice.for_request(asked), asked.limits)
    except (NoFrontError, UnknownDeviceError) as error:
        raise Http404(str(error)) from error


def points_table(shown: Advice) -> Table:
    """A row per configuration, probes last."""
    chosen = shown.chosen.configuration if shown.chosen else None
    return Table(
        (
            "configuration", "state", "probe", "recommended", "speedup", "low", "high", "ate_max_m",
            "runtime_s",
        ),
        [
            (
                point.configuration, point.state, point.probe,
                point.configuration == chosen, point.ratio, point.low, point.high, point.ate_max,
                shown.seconds(point),
            )
            for point in shown.answer.expectation.points
        ],
    )  # fmt: skip


def _title(shown: Advice) -> str:
    return f"Front {shown.answer.front.slug} on {shown.answer.about}"


def _n(shown: Advice) -> str:
    points = shown.answer.expectation.points
    here = sum(point.measured for point in points)
    return f"{formats.plural(len(points), 'configuration')}, {here} of them measured on the device"


DRAWINGS = (
    Drawing(
        name="device-front",
        path="devices/<slug:slug>/front",
        definition=DEFINITION,
        read=read_device,
        draw=device_plane,
        table=points_table,
        title=_title,
        n=_n,
        page=lambda slug: reverse("dashboard:device", args=[slug]),
    ),
    Drawing(
        name="recommendation",
        path="recommend",
        definition=DEFINITION,
        read=read_request,
        draw=device_plane,
        table=points_table,
        title=_title,
        n=_n,
        page=lambda: reverse("dashboard:recommend"),
    ),
)
