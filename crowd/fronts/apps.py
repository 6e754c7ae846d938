from django.apps import AppConfig
from django.db.models.signals import post_migrate, pre_migrate


class FrontsConfig(AppConfig):
    name = "crowd.fronts"

    def ready(self) -> None:
        """Create triggers and roles after migrations."""
        from crowd.access import roles
        from crowd.fronts.publishing import guards

        pre_migrate.connect(guards.drop, sender=self)
        post_migrate.connect(guards.create, sender=self)
        post_migrate.connect(roles.grant)
