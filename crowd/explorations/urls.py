"""Addresses of explorations under /api/v1/."""

from django.urls import path

from crowd.explorations import views

LEASES = [
    path("leases", views.LeasesView.as_view()),
    path("leases/<int:key>-<int:attempt>/heartbeat", views.HeartbeatView.as_view()),
    path("leases/<int:key>-<int:attempt>/result", views.ResultView.as_view()),
]
urlpatterns = [
    path("explorations", views.ExplorationsView.as_view()),
    path("explorations/<int:key>", views.ExplorationView.as_view()),
    *LEASES,
]
