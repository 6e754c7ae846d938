"""Addresses of devices under /api/v1/, besides those of their results."""

from django.urls import path

from crowd.devices import views

urlpatterns = [
    path("models", views.ModelsView.as_view()),
    path("attempts", views.AttemptsView.as_view()),
]
