"""The list of fronts, and the page of a front."""

from django.http import HttpRequest, HttpResponse
from django.shortcuts import render
from msgspec.structs import asdict

from crowd.dashboard.comparing.application_choice import application_option
from crowd.dashboard.comparing.versions import UnknownVersionError, compare_versions
from crowd.dashboard.content.advice import AdviceRequest, Limits, for_any_device
from crowd.dashboard.content.parameter_bars import Row, parameter_bars
from crowd.dashboard.content.points import measured_front, results_by_sequence
from crowd.dashboard.figures.fronts import HEIGHT
from crowd.dashboard.figures.transfer import winners_height
from crowd.dashboard.filtering import Filtering, filtered
from crowd.dashboard.responses import or_404, page
from crowd.explorations import selectors as searches
from crowd.fronts import selectors as published
from crowd.fronts.content import plans
from crowd.fronts.content.generalisation import FACTOR, MARGIN
from crowd.predictions.selectors import DeviceQuery
from wire.front import DEFAULT

ACCURATE = Limits(max_ate=0.02)


@page
def fronts(request: HttpRequest) -> HttpResponse:
    """All released fronts, newest first. Those that clients measure now are marked."""
    shown = published.fronts()
    # Of each application the newest, which comes last here.
    newest = {front.application: front.slug for front in reversed(shown) if front.state == "published"}
    current = set(newest.values())
    outdated = {front.slug for front in shown if front.slug in current and plans.outdated(front)}
    context = {"fronts": shown, "measured_now": current - outdated, "outdated": outdated}
    return render(request, "dashboard/fronts.html", context)


@filtered
def front(request: HttpRequest, asked: Filtering, slug: str) -> HttpResponse:
    """A front: its points as predicted and as measured, and the difference from another version."""
    asked, shown = asked.front_scope, or_404(published.front(slug))
    versions = [name for name, application in asked.published if application == shown.application]
    problem = ""
    try:
        difference = compare_versions(shown, versions, request.GET.get("against", ""))
    except UnknownVersionError as error:
        difference, problem = compare_versions(shown, versions, ""), str(error)
    measured = measured_front(shown, asked.filters)
    default = shown.point(DEFAULT)
    columns, rows = results_by_sequence(shown)
    measured_now = slug in published.measured_now().values()
    return render(
        request,
        "dashboard/front.html",
        {
            "asked": asked,
            "front": shown,
            "protocol": asdict(shown.protocol),
            "shown": measured,
            "height": HEIGHT,
            "factor": FACTOR,
            "margin": MARGIN,
            "sequences": columns,
            "sequence_rows": rows if columns else (),
            "bars": parameter_bars(
                [Row(point.name, point.runtime, point.ate_max, point.parameters) for point in shown.points],
                default.parameters if default else None,
            ),
            "winners_height": winners_height(len(measured.winners.counts)),
            "query": measured.filters.query(),
            "crowd_query": asked.filters.query(),
            "application_option": application_option(shown.application),
            "versions": [name for name in versions if name != slug],
            "difference": difference,
            "problem": problem,
            "prepared": shown.provenance.get("prepared"),
            "exploration": searches.exploration_key(shown),
            "preparation": searches.preparation_key(shown.slug),
            "outdated": plans.outdated(shown),
            "measured_now": measured_now,
            "advice_query": AdviceRequest(
                DeviceQuery(), application_option(shown.application), ACCURATE
            ).query,
            "advice": for_any_device(shown, ACCURATE) if measured_now else None,
        },
        status=400 if problem else 200,
    )
