"""API addresses of fronts."""

from django.urls import path

from crowd.fronts import views

urlpatterns = [
    path("fronts", views.FrontsView.as_view()),
    path("fronts/<str:version>", views.FrontView.as_view()),
]
