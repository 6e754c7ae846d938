"""What differs from run to run, fixed: the clock, random numbers, keys of rows, settings, caches."""

import os
import random
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

import pytest
from django.apps import apps
from django.core.cache import cache
from django.core.management.color import no_style
from django.db import connection
from django.db.models import AutoField
from django.test import override_settings
from django.utils import timezone

from crowd.explorations.measuring import software
from crowd.results.reading.versioned_cache import VersionedCache
from tests.server import CACHES
from tests.shipped import FIXTURES

SETTINGS = {
    "SECRET_KEY": "snapshots",
    "FRONTRUNNER_RARE_BELOW": 2,
    "FRONTRUNNER_QUORUM": 2,
    "FRONTRUNNER_ENROLMENTS_PER_HOUR": 0,
    "FRONTRUNNER_ATTEMPTS_PER_HOUR": 0,
    "FRONTRUNNER_READS_PER_MINUTE": 0,
    "FRONTRUNNER_PAGES_PER_MINUTE": 0,
    "FRONTRUNNER_SUBMISSIONS_PER_MINUTE": 0,
    "FRONTRUNNER_OWN_REQUESTS_PER_MINUTE": 0,
    "FRONTRUNNER_MAX_BODY_BYTES": 1 << 19,
    "FRONTRUNNER_MAX_INFLATED_BYTES": 1 << 20,
}


class World:
    """A world in which nothing happens by chance. `now` is its time, which only stands or is set."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self._patch = patch
        self._random = random.Random()
        self.now = datetime(2026, 11, 20, 12, tzinfo=UTC)
        patch.setattr(timezone, "now", lambda: self.now)
        patch.setattr(time, "time", lambda: self.now.timestamp())
        # uuid4 and secrets draw from here.
        patch.setattr(os, "urandom", lambda count: self._random.randbytes(count))
        patch.setattr(random, "_urandom", lambda count: self._random.randbytes(count))
        # With the commit in a checkout.
        patch.setattr(software, "software_version", lambda: "0.0.0+commit")

    def begin(self, step: str) -> None:
        """Begin `step`: its random numbers do not depend on earlier ones. All caches are empty."""
        self._random.seed(step)
        cache.clear()
        for name in CACHES:
            self._patch.setattr(f"crowd.{name}", VersionedCache(8))


@contextmanager
def world(folder: Path) -> Iterator[World]:
    """The world, with its files below `folder`. Keys of rows begin at 1."""
    sequences = [folder / "sequences", FIXTURES / "sequences"]
    settings = SETTINGS | {"FRONTRUNNER_SEQUENCES": sequences}
    with pytest.MonkeyPatch.context() as patch, override_settings(**settings):
        _restart_keys()
        yield World(patch)


def _restart_keys() -> None:
    numbered = [
        {"table": model._meta.db_table, "column": model._meta.pk.column}
        for model in apps.get_models()
        if model.__module__.startswith("crowd.") and isinstance(model._meta.pk, AutoField)
    ]
    with connection.cursor() as cursor:
        for statement in connection.ops.sequence_reset_by_name_sql(no_style(), numbered):
            cursor.execute(statement)
