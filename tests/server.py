"""Fixtures of tests that need Django: the conftest of each package of such tests imports them.

They keep every test away from the data folder of a server that its developer may be running.
"""

from pathlib import Path
from typing import Any

import pytest
from django.conf import settings as django_settings

from crowd.celery import app
from crowd.demo import mark
from crowd.results.reading.versioned_cache import VersionedCache

__all__ = [
    "demo",
    "django_db_modify_db_settings",
    "django_db_setup",
    "no_front_is_known",
    "nothing_is_cached",
    "own_data_folder",
]

# Argon2 is slow on purpose, for passwords that somebody wants to guess.
django_settings.PASSWORD_HASHERS = ["django.contrib.auth.hashers.MD5PasswordHasher"]
# Tasks run where they are sent, and no message reaches a worker outside the tests.
app.conf.update(task_always_eager=True, task_eager_propagates=True, broker_url="memory://")


@pytest.fixture(scope="session")
def django_db_modify_db_settings(tmp_path_factory: pytest.TempPathFactory) -> None:
    """SQLite in a file, as in production: in memory it refuses a second writer instead of waiting."""
    database = django_settings.DATABASES["default"]
    if database["ENGINE"] == "django.db.backends.sqlite3":
        database.setdefault("TEST", {})["NAME"] = str(tmp_path_factory.mktemp("database") / "test.sqlite3")


@pytest.fixture(scope="session")
def django_db_setup(django_db_setup: None, django_db_blocker: Any) -> None:
    """Asked once, so that tests that count queries do not depend on which comes first."""
    with django_db_blocker.unblock():
        mark.is_demo()


@pytest.fixture
def demo(db: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """The test's server is a demo."""
    mark.DemoMark.objects.create(pk=1)
    monkeypatch.setattr(mark, "_is_marked", lambda: True)


@pytest.fixture(autouse=True)
def own_data_folder(settings: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An empty data folder; static files from their sources; sequences only where a test puts them."""
    folder = tmp_path_factory.mktemp("var")
    settings.FRONTRUNNER_VAR = folder
    # Tests name the devices they measure, once each. What becomes of rare ones has tests of its own.
    settings.FRONTRUNNER_RARE_BELOW = 1
    # And a single participant confirms a figure.
    settings.FRONTRUNNER_QUORUM = 1
    settings.FRONTRUNNER_SEQUENCES = [folder / "sequences"]
    settings.STATIC_ROOT = folder / "static"
    settings.STATIC_ROOT.mkdir()
    settings.STORAGES = settings.STORAGES | {
        "staticfiles": {"BACKEND": "django.contrib.staticfiles.storage.StaticFilesStorage"}
    }
    return folder


@pytest.fixture(autouse=True)
def no_front_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each test has a database of its own, where other fronts go by the same names."""
    monkeypatch.setattr("crowd.results.intake.admission._released_fronts", {})


CACHES = (
    "results.reading.speedups._speedups_cache",
    "results.reading.speedups._front_cache",
    "results.reading.transferring.tables._cache",
    "results.reading.devices._devices_cache",
    "dashboard.content.points._measured_cache",
    "dashboard.content.searches._outcomes",
    "dashboard.drawings.speedups._pictures",
)


@pytest.fixture(autouse=True)
def nothing_is_cached(monkeypatch: pytest.MonkeyPatch) -> None:
    """And revisions of another test's database mean other figures."""
    for cache in CACHES:
        monkeypatch.setattr(f"crowd.{cache}", VersionedCache(8))
