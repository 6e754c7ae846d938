"""The Celery application. A message only says "look at row N": a lost one costs time, never data."""

import os

from celery import Celery
from celery.signals import before_task_publish, task_prerun
from kombu.transport import TRANSPORT_ALIASES

from crowd import logs

os.environ.setdefault("DJANGO_SETTINGS_MODULE", "crowd.settings")

# Addresses filesystem:// mean our own, which survives kill -9.
TRANSPORT_ALIASES["filesystem"] = "crowd.filesystem_broker:Transport"

app = Celery("crowd")
app.config_from_object("django.conf:settings", namespace="CELERY")
app.autodiscover_tasks()

before_task_publish.connect(logs.send_along)
task_prerun.connect(logs.take_up)
