"""The addresses of a search's own server: workers lease configurations, and nothing else is there."""

from django.urls import include, path, re_path

from crowd.explorations.urls import LEASES
from crowd.http import problems
from crowd.operations import health

handler400 = "crowd.http.problems.bad_request_view"
handler500 = "crowd.http.problems.server_error_view"

urlpatterns = [
    path("healthz", health.healthz),
    path("api/v1/", include(LEASES)),
    re_path("", problems.not_found_view),
]
