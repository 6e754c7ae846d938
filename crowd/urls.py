"""Every address of the site: the API under /api/v1, the pages at the root."""

from django.contrib import admin
from django.urls import include, path

urlpatterns = [
    path("admin/", admin.site.urls),
    path("api/v1/", include("crowd.explorations.urls")),
    path("", include("crowd.dashboard.urls")),
]
