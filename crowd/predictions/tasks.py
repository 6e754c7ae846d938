"""Celery tasks: they may run twice or never without harm."""

from celery import shared_task

from crowd.predictions import maps


@shared_task
def rebuild() -> None:
    """Learn the maps of devices again, once a day."""
    maps.rebuild_if_due()
