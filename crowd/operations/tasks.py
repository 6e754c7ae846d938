"""Celery tasks for monitoring the server."""

from celery import shared_task

from crowd.operations import row_counts


@shared_task
def count_rows() -> None:
    """Store how many rows the growing tables have, for /metrics."""
    row_counts.count_if_due()
