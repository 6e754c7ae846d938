"""The Celery application. A message only says "look at row N": a lost one costs time, never data."""

import os
from typing import Any

from celery import Celery
from celery.signals import before_task_publish, task_prerun
from django.db import close_old_connections
from kombu.transport import TRANSPORT_ALIASES

from crowd.operations import logs

os.environ.setdefault("DJANGO_SETTINGS_MODULE", "crowd.settings")

# Addresses filesystem:// mean our own, which survives kill -9.
TRANSPORT_ALIASES["filesystem"] = "crowd.operations.filesystem_broker:Transport"

app = Celery("crowd")
app.config_from_object("django.conf:settings", namespace="CELERY")
app.autodiscover_tasks()

before_task_publish.connect(logs.send_along)
task_prerun.connect(logs.take_up)


@task_prerun.connect
def check_connections(task: Any = None, **_: object) -> None:
    """Before a task as before a request: a connection that is broken or too old is given up.

    A task that runs where it is called shares its caller's connection, which may be in a transaction.
    """
    if not task.request.is_eager:
        close_old_connections()
