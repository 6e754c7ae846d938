"""Addresses of devices under /api/v1/ that need no measurement."""

from django.urls import path

from crowd.devices import views

urlpatterns = [
    path("attempts", views.AttemptsView.as_view()),
    path("models", views.ModelsView.as_view()),
]
