from django.apps import AppConfig
from django.db.models.signals import pre_migrate


class OperationsConfig(AppConfig):
    name = "crowd.operations"

    def ready(self) -> None:
        """Check a database before any application's tables change."""
        from crowd.database.upgrade import refuse_before_1_0

        pre_migrate.connect(refuse_before_1_0)
