from django.apps import AppConfig
from django.db.models.signals import post_migrate, pre_migrate


class AuditConfig(AppConfig):
    name = "crowd.audit"

    def ready(self) -> None:
        """Connect the triggers that protect the log to the migrations."""
        from crowd.audit import guards

        pre_migrate.connect(guards.drop, sender=self)
        post_migrate.connect(guards.create, sender=self)
