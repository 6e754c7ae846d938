"""The addresses of a search's own server: workers lease configurations, and nothing else is there."""

from django.urls import include, path

from crowd.explorations.urls import LEASES
from crowd.operations import health

urlpatterns = [path("healthz", health.healthz), path("api/v1/", include(LEASES))]
