from django.apps import AppConfig


class ResultsConfig(AppConfig):
    name = "crowd.results"

    def ready(self) -> None:
        """Connect signals: figures follow changed models, files of the open data follow erasures."""
        from crowd.devices.signals import models_changed
        from crowd.results.marking import files_stale
        from crowd.results.tasks import announce_models, announce_stale_files

        models_changed.connect(announce_models)
        files_stale.connect(announce_stale_files)
