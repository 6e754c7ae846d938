"""Addresses of results under /api/v1/."""

from django.urls import path

from crowd.results.api import own_views, public_views, session_views, views
from crowd.results.opendata.views import ExportsView

urlpatterns = [
    path("enrol", views.EnrolView.as_view()),
    path("submissions", views.SubmissionsView.as_view()),
    path("submissions:validate", views.ValidationView.as_view()),
    path("submissions/<uuid:key>", views.SubmissionView.as_view()),
    path("me", own_views.OwnView.as_view()),
    path("me/data", own_views.OwnDataView.as_view()),
    path("me/token", own_views.OwnTokenView.as_view()),
    path("me/runs/<uuid:key>", own_views.OwnRunView.as_view()),
    path("exports", ExportsView.as_view()),
    path("speedups", public_views.SpeedupsView.as_view()),
    path("devices", public_views.DevicesView.as_view()),
    path("devices/<slug:slug>", public_views.DeviceView.as_view()),
    path("sessions", session_views.SessionsView.as_view()),
    path("sessions/<uuid:key>", session_views.SessionView.as_view()),
    path("runs", session_views.RunsView.as_view()),
    path("compare", public_views.CompareView.as_view()),
]
