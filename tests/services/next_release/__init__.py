"""Settings of a next release with two more migrations, each of which changes rows and then their table."""

from crowd.settings import *  # noqa: F403

MIGRATION_MODULES = {name: f"{__name__}.{name}" for name in ("devices", "results")}
