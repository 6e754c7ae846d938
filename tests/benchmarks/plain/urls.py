"""The peer's addresses."""

from django.http import HttpRequest, HttpResponse
from django.urls import path

from tests.benchmarks.plain.views import ParseOnlyView, SubmissionsView


def healthz(request: HttpRequest) -> HttpResponse:
    return HttpResponse("ok")


urlpatterns = [
    path("healthz", healthz),
    path("api/v1/submissions", SubmissionsView.as_view()),
    path("parse-only", ParseOnlyView.as_view()),
]
