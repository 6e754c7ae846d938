"""The pages that describe the API: an index, and a page for every call."""

from django.http import Http404, HttpRequest, HttpResponse
from django.shortcuts import render
from django.views.decorators.http import require_safe

from crowd.access import limits
from crowd.api_pages import calls
from crowd.api_pages.openapi import document
from crowd.api_pages.topics import TOPICS
from crowd.http import codes
from crowd.http.api import DEFAULT_LIMIT, MAX_LIMIT
from crowd.results.intake import daily_limits


@require_safe
def index(request: HttpRequest) -> HttpResponse:
    """Every call by topic, the limits in force, and every code."""
    operations = calls.operations(document())
    topics = [
        {
            "topic": topic,
            "calls": [
                {"key": key, "method": method, "path": path, "summary": operation["summary"]}
                for key, (method, path, operation) in ((key, operations[key]) for key in topic.calls)
            ],
        }
        for topic in TOPICS
    ]
    context = {
        "topics": topics,
        "groups": codes.GROUPS,
        "rejected_runs": codes.REJECTED_RUNS,
        "limits": limits.in_force(),
        "daily": daily_limits.active_limits(),
        "per_address": daily_limits.ADDRESS_FACTOR,
        "page": DEFAULT_LIMIT,
        "longest_page": MAX_LIMIT,
    }
    return render(request, "api/docs.html", context)


@require_safe
def call(request: HttpRequest, key: str) -> HttpResponse:
    """The page of one call. Raises Http404 for an unknown `key`."""
    if key not in calls.operations(document()):
        raise Http404(f"the API has no call {key}")
    server = request.build_absolute_uri("/").rstrip("/")
    return render(request, "api/call.html", {"call": calls.call(document(), key, server)})
