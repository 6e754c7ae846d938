"""Fills a demo server, once. Importing this module imports pandas and Arrow, which is slow."""

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from celery import current_app
from django.conf import settings
from django.utils import timezone

from crowd.demo.mark import admitting
from crowd.devices.models import DeviceModel, Installation
from crowd.predictions import maps
from crowd.results.figures import recomputing
from crowd.results.models import Export
from crowd.results.opendata import exports
from crowd.results.privacy.disclosure_sync import sync_disclosure
from crowd.simulation import exploration
from crowd.simulation.crowd import Crowd, Progress
from crowd.simulation.transport import Transport

EACH = 20
UNLIMITED = (
    "FRONTRUNNER_BYTES_PER_DAY", "FRONTRUNNER_VALUES_PER_DAY", "FRONTRUNNER_STORED_BYTES_PER_DAY",
    "FRONTRUNNER_READS_PER_MINUTE", "FRONTRUNNER_OWN_REQUESTS_PER_MINUTE",
)  # fmt: skip

Say = Callable[[str], object]


def fill(devices: int, seed: int, say: Say) -> None:
    """Fill this demo server with `devices` devices, by `seed`, unless that is done. `say` receives the
    progress.

    What was interrupted is continued. Raises RefusedError.
    """
    transport = Transport()
    with admitting(), _alone():
        crowd = Crowd(transport, devices, seed, timezone.now())
        if Installation.objects.exists() and not crowd.has_sent(0):
            say("Demo: this server was filled before, with another seed or front; it stays as it is")
            return
        if Export.objects.exists() and crowd.has_sent(devices - 1):
            return
        _report(crowd.send(), devices, "", say)
        recomputing.recompute(lambda _done: None)
        _report(crowd.send_probes(), devices, " of probes", say)
        exploration.run_once(transport, crowd.manifest["sequence"], seed)
        recomputing.recompute(lambda _done: None)
        sync_disclosure(DeviceModel.objects.order_by("pk").values_list("pk", flat=True))
        maps.rebuild()
        exports.create_export()
    say(f"Demo: {devices} simulated devices, probes and an exploration are there")


def _report(progress: Iterator[Progress], devices: int, kind: str, say: Say) -> None:
    for done in progress:
        if done.devices % EACH == 0 or done.devices == devices:
            say(
                f"Demo: {done.devices} of {devices} devices, {done.sessions} sessions{kind}, {done.runs} runs"
            )


@contextmanager
def _alone() -> Iterator[None]:
    """While this process is its own client: no limits, no lines of requests, no messages to workers."""
    requests = logging.getLogger("crowd.requests")
    before: dict[str, Any] = {name: getattr(settings, name) for name in UNLIMITED}
    level, broker = requests.level, current_app.conf.broker_url
    requests.setLevel(logging.WARNING)
    # Everything is computed here; messages would make workers do it again.
    current_app.conf.broker_url = "memory://localhost/"
    for name in before:
        setattr(settings, name, 0)
    try:
        yield
    finally:
        for name, value in before.items():
            setattr(settings, name, value)
        current_app.conf.broker_url = broker
        requests.setLevel(level)
