from django.apps import AppConfig


class ResultsConfig(AppConfig):
    name = "crowd.results"
