"""The crowd's server: fronts go out, measurements come in, speedups are shown."""

from crowd.celery import app as celery_app

__all__ = ["celery_app"]
