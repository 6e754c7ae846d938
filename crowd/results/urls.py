"""Addresses of results under /api/v1/."""

from django.urls import path

from crowd.results import public_views, views

urlpatterns = [
    path("enrol", views.EnrolView.as_view()),
    path("submissions", views.SubmissionsView.as_view()),
    path("submissions:validate", views.ValidationView.as_view()),
    path("submissions/<uuid:key>", views.SubmissionView.as_view()),
    path("me", views.OwnView.as_view()),
    path("me/data", views.OwnDataView.as_view()),
    path("me/runs/<uuid:key>", views.OwnRunView.as_view()),
    path("speedups", public_views.SpeedupsView.as_view()),
    path("devices", public_views.DevicesView.as_view()),
    path("devices/<slug:slug>", public_views.DeviceView.as_view()),
    path("compare", public_views.CompareView.as_view()),
]
