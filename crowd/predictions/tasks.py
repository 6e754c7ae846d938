"""Celery tasks. Each may run twice, or be lost, without harm."""

from celery import shared_task


@shared_task
def rebuild() -> None:
    """Rebuild the maps of devices once a day."""
    from crowd.predictions import maps  # 80 MB with pandas: only for workers that need it

    maps.rebuild_if_due()
