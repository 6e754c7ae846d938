"""Addresses of predictions under /api/v1/."""

from django.urls import path

from crowd.predictions import views

urlpatterns = [
    path("manifest", views.AssignedManifestView.as_view()),
    path("recommendation", views.RecommendationView.as_view()),
]
