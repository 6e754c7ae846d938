"""Addresses of explorations under /api/v1/."""

from django.urls import path

from crowd.explorations import views

urlpatterns = [
    path("explorations", views.ExplorationsView.as_view()),
    path("explorations/<int:key>", views.ExplorationView.as_view()),
]
