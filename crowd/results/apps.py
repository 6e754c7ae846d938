from django.apps import AppConfig


class ResultsConfig(AppConfig):
    name = "crowd.results"

    def ready(self) -> None:
        """Figures follow what is decided about models."""
        from crowd.devices.signals import models_changed
        from crowd.results.tasks import announce_models

        models_changed.connect(announce_models)
