from django.apps import AppConfig

from crowd.dashboard.catalogues import compile_catalogues


class DashboardConfig(AppConfig):
    name = "crowd.dashboard"

    def ready(self) -> None:
        compile_catalogues()
