"""Every address of the site: the API under /api/v1, the pages at the root."""

from django.contrib import admin
from django.urls import include, path, re_path

from crowd.api_pages import openapi
from crowd.api_pages import views as api_pages
from crowd.fronts.views import chunk, module, plan, shaders, trajectory, vectors
from crowd.guide import guide
from crowd.http import problems
from crowd.operations import health
from crowd.results.opendata.serving import export_file

handler400 = "crowd.http.problems.bad_request_view"
handler500 = "crowd.http.problems.server_error_view"

urlpatterns = [
    path("admin/", admin.site.urls),
    path("healthz", health.healthz),
    path("readyz", health.readyz),
    path("metrics", health.metrics),
    path("sequences/<str:sha256>", chunk, name="chunk"),
    path("trajectories/<str:sha256>", trajectory, name="trajectory"),
    path("plans/<str:sha256>", plan, name="plan"),
    path("shaders/<str:sha256>", shaders, name="shaders"),
    path("modules/<str:sha256>", module, name="module"),
    path("vectors/kfusion.json.gz", vectors, name="vectors"),
    path("data/<str:name>/<str:file>", export_file, name="export-file"),
    path("api/v1/", include("crowd.fronts.urls")),
    path("api/v1/", include("crowd.devices.urls")),
    path("api/v1/", include("crowd.results.api.urls")),
    path("api/v1/", include("crowd.predictions.urls")),
    path("api/v1/", include("crowd.explorations.urls")),
    path("api/v1/openapi.json", openapi.OpenApiView.as_view(), name="openapi"),
    path("api/v1/docs", api_pages.index, name="docs"),
    path("api/v1/docs/<slug:key>", api_pages.call, name="docs-call"),
    path("guide/", guide, {"path": ""}, name="guide"),
    path("guide/<path:path>", guide, name="guide-file"),
    re_path(r"^api/", problems.not_found_view),
    path("", include("crowd.dashboard.urls")),
]
