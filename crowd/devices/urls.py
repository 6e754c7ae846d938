"""API addresses of devices that do not need measurements."""

from django.urls import path

from crowd.devices import views

urlpatterns = [
    path("attempts", views.AttemptsView.as_view()),
    path("models", views.ModelsView.as_view()),
]
