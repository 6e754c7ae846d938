from django.apps import AppConfig


class PredictionsConfig(AppConfig):
    name = "crowd.predictions"

    def ready(self) -> None:
        """Delete recommendations that depend on erased measurements."""
        from crowd.predictions.erasing import forget_erased
        from crowd.results.privacy.signals import measurements_erased

        measurements_erased.connect(forget_erased)
