"""The page of recommendations."""

from typing import Any

from django.http import HttpRequest, HttpResponse, HttpResponseRedirect
from django.shortcuts import render
from django.utils.cache import patch_vary_headers

from crowd.dashboard.comparing.application_choice import application_option, next_query
from crowd.dashboard.content import advice
from crowd.dashboard.content.advice import Advice, AdviceRequest, DevicePrediction, Slider
from crowd.dashboard.drawings.drawing import with_query
from crowd.dashboard.filtering import SCRIPT
from crowd.dashboard.responses import page
from crowd.fronts import selectors as published
from crowd.fronts.selectors import DEFAULT_APPLICATION
from crowd.predictions.selectors import NoFrontError, NothingConfirmedError, UnknownDeviceError
from crowd.results.reading.queries.filters import InvalidFilterError


@page
def recommend(request: HttpRequest) -> HttpResponse:
    """The recommended configuration for a device, or for any, within the limits of the query string."""
    problem = ""
    try:
        asked = AdviceRequest.of(request.GET)
    except InvalidFilterError as error:
        application = request.GET.get("application", "")
        asked, problem = AdviceRequest.of({"application": application}), str(error)
    address = with_query(request.path, asked.query)
    by_script = SCRIPT in request.headers
    if "" in request.GET.values() and not by_script and not problem:
        # Without a script, a form also sends its empty fields.
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


def _shown(asked: AdviceRequest) -> dict[str, Any]:
    names = published.names()
    nothing, advised, reference = "", None, None
    try:
        advised = Advice.of(advice.for_request(asked), asked.limits)
    except NothingConfirmedError as error:
        nothing, reference = str(error), Advice.of(DevicePrediction(error.reference, None), asked.limits)
    except (NoFrontError, UnknownDeviceError) as error:
        nothing = str(error)
    applications = sorted({name for _, name in names}, key=lambda name: (name != DEFAULT_APPLICATION, name))
    application = advised.answer.front.application if advised else asked.application
    return {
        "asked": asked,
        "advice": advised,
        "nothing": nothing,
        "reference": reference,
        "fronts": bool(names),
        "application": application or DEFAULT_APPLICATION,
        "choices": [(name, f"?{asked.query_with(name)}") for name in applications],
        "query": asked.query,
        "slider": advised.slider if advised else Slider.over([], asked.limits.max_ate),
        "milliseconds": asked.limits.parameters().get("max_ms", ""),
        "anything": f"?{asked.for_any_device.query}",
        "application_option": application_option(application) if advised else "",
        "next_query": next_query(application, names) if advised else "",
    }
