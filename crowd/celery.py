"""The Celery application. A message contains only the key of a row: a lost one costs time, never data."""

import os
from typing import Any

from celery import Celery
from celery.signals import (
    beat_init,
    before_task_publish,
    task_postrun,
    task_prerun,
    worker_init,
    worker_process_init,
)
from django.db import close_old_connections
from kombu.transport import TRANSPORT_ALIASES

from crowd.observability import logs, reporting, task_metrics

os.environ.setdefault("DJANGO_SETTINGS_MODULE", "crowd.settings")
os.environ.setdefault("SKIP_CHECKS", "true")  # a worker would import all views for Django's checks

# filesystem:// is our own transport, which survives kill -9.
TRANSPORT_ALIASES["filesystem"] = "crowd.operations.filesystem_broker:Transport"

app = Celery("crowd")
app.config_from_object("django.conf:settings", namespace="CELERY")
app.autodiscover_tasks()

before_task_publish.connect(logs.add_request_id)
task_prerun.connect(logs.set_request_id)


def check_connections(task: Any = None, **_: object) -> None:
    """Close a database connection that is broken or too old, as Django does before a request.

    An eager task shares its caller's connection, which may be in a transaction.
    """
    if not task.request.is_eager:
        close_old_connections()


task_prerun.connect(check_connections)

task_prerun.connect(task_metrics.begin)
task_postrun.connect(task_metrics.end)
worker_init.connect(task_metrics.share)  # a worker that carries out tasks itself
worker_process_init.connect(task_metrics.share)  # a process of its pool

worker_init.connect(reporting.start)
beat_init.connect(reporting.start)
