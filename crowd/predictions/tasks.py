"""Celery tasks: they may run twice or never without harm."""

from celery import shared_task


@shared_task
def rebuild() -> None:
    """Learn the maps of devices again, once a day."""
    from crowd.predictions import maps  # 80 MB with pandas: not in workers that never learn one

    maps.rebuild_if_due()
