from django.apps import AppConfig
from django.db.models.signals import post_migrate, pre_migrate


class FrontsConfig(AppConfig):
    name = "crowd.fronts"

    def ready(self) -> None:
        """Tie what a migrated database needs besides tables: triggers and roles."""
        from crowd.access import roles
        from crowd.fronts.publishing import guards

        pre_migrate.connect(guards.take_off, sender=self)
        post_migrate.connect(guards.put_on, sender=self)
        post_migrate.connect(roles.grant)
