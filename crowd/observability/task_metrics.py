"""Counts the tasks of a worker, and measures their seconds."""

import time
from typing import Any

from django.conf import settings

from crowd.observability import metrics

_begun: dict[str, float] = {}


def share(**_: object) -> None:
    """Let the web server of this machine see the metrics of this worker."""
    metrics.registry.share(settings.FRONTRUNNER_VAR / "metrics", "worker")


def begin(task_id: str, **_: object) -> None:
    """Before Celery runs a task, store the time."""
    _begun[task_id] = time.perf_counter()


def end(task_id: str, task: Any, state: str | None = None, **_: object) -> None:
    """Count a task by its state: success, failure or retry. An eager task is a part of its request."""
    seconds = time.perf_counter() - _begun.pop(task_id)
    if not task.request.is_eager:
        metrics.registry.observe("task_seconds", seconds, task.name, (state or "unknown").lower())
