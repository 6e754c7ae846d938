from django.apps import AppConfig
from django.db.models.signals import post_migrate, pre_migrate


class AuditConfig(AppConfig):
    name = "crowd.audit"

    def ready(self) -> None:
        """Connect the triggers that protect the log to the migrations, and the log to accounts."""
        from crowd.audit import accounts, guards

        accounts.connect()
        pre_migrate.connect(guards.drop, sender=self)
        post_migrate.connect(guards.create, sender=self)
