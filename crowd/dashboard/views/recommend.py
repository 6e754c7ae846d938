"""What to use on a device that a visitor names."""

from typing import Any

from django.http import HttpRequest, HttpResponse, HttpResponseRedirect
from django.shortcuts import render
from django.utils.cache import patch_vary_headers

from crowd.dashboard.answering import page
from crowd.dashboard.comparing.application_choice import named, onward
from crowd.dashboard.content import advice
from crowd.dashboard.content.advice import Advice, Asked, Slider
from crowd.dashboard.drawings.drawing import with_query
from crowd.dashboard.filtering import SCRIPT
from crowd.fronts import selectors as published
from crowd.fronts.selectors import DEFAULT_APPLICATION
from crowd.predictions.selectors import NoFrontError, UnknownDeviceError
from crowd.results.reading.queries.filters import InvalidFilterError

CROWD = ("application", "simulated")


@page
def recommend(request: HttpRequest) -> HttpResponse:
    """The configuration for a device, or for any, within the limits of the query string."""
    problem = ""
    try:
        asked = Asked.of(request.GET)
    except InvalidFilterError as error:
        crowd = {name: request.GET[name] for name in CROWD if name in request.GET}
        asked, problem = Asked.of(crowd), str(error)
    address = with_query(request.path, asked.query)
    by_script = SCRIPT in request.headers
    if "" in request.GET.values() and not by_script and not problem:
        # A form without a script sends its empty fields as well.
        return HttpResponseRedirect(address)
    response = render(
        request,
        "dashboard/recommend.html",
        _shown(asked) | {"problem": problem},
        status=400 if problem else 200,
    )
    if by_script:
        response["HX-Push-Url"] = address
    patch_vary_headers(response, [SCRIPT])
    return response


def _shown(asked: Asked) -> dict[str, Any]:
    names = published.names()
    nothing, found = "", None
    try:
        found = Advice.of(advice.ask(asked), asked.limits)
    except (NoFrontError, UnknownDeviceError) as error:
        nothing = str(error)
    applications = sorted({name for _, name in names}, key=lambda name: (name != DEFAULT_APPLICATION, name))
    application = found.answer.front.application if found else asked.application
    return {
        "asked": asked,
        "advice": found,
        "nothing": nothing,
        "fronts": bool(names),
        "application": application or DEFAULT_APPLICATION,
        "choices": [(name, f"?{asked.query_with(name)}") for name in applications],
        "query": asked.query,
        "slider": found.slider if found else Slider.over([], asked.limits.max_ate),
        "milliseconds": asked.limits.parameters().get("max_ms", ""),
        "anything": f"?{asked.of_any_device.query}",
        "named": named(application) if found else "",
        "onward": onward(application, names) if found else "",
    }
