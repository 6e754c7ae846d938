"""Keeps every test away from the data folder of a server that its developer may be running."""

from pathlib import Path
from typing import Any

import hypothesis
import pytest
from django.conf import settings as django_settings
from xdist.scheduler import LoadScopeScheduling

from crowd.celery import app
from crowd.results.reading.versioned_cache import VersionedCache
from tests import guide as documentation
from tests.wheel import build

# How fast a loaded machine makes up examples says nothing of the code.
hypothesis.settings.register_profile(
    "patient", deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile("patient")
# Tasks run where they are sent, and no message reaches a worker outside the tests.
app.conf.update(task_always_eager=True, task_eager_propagates=True, broker_url="memory://")


# Their tests start servers, workers and browsers, and wait for them: one after another, beside the rest.
ONE_BY_ONE = ("tests/services/", "tests/browser/")
# This one runs other tests on a database of its own and waits for nothing: it may run beside them.
BESIDE = "tests/services/test_same_on_postgresql.py"


class ByRoom(LoadScopeScheduling):
    """Where pytest-xdist spreads the tests: those that start programs in one process, the others by file."""

    def _split_scope(self, nodeid: str) -> str:
        one_by_one = nodeid.startswith(ONE_BY_ONE) and not nodeid.startswith(BESIDE)
        return "programs" if one_by_one else nodeid.split("::")[0]


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> ByRoom:
    return ByRoom(config, log)


@pytest.fixture(scope="session")
def django_db_modify_db_settings(tmp_path_factory: pytest.TempPathFactory) -> None:
    """SQLite in a file, as in production: in memory it refuses a second writer instead of waiting."""
    database = django_settings.DATABASES["default"]
    if database["ENGINE"] == "django.db.backends.sqlite3":
        database.setdefault("TEST", {})["NAME"] = str(tmp_path_factory.mktemp("database") / "test.sqlite3")


@pytest.fixture(scope="session")
def guide(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The guide's pages, built once."""
    return documentation.build(tmp_path_factory.mktemp("guide"))


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory, guide: Path) -> Path:
    """The project's wheel with the guide in it, built once."""
    return build(tmp_path_factory.mktemp("wheel"), guide)


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
    monkeypatch.setattr("crowd.results.intake.checking._released", {})


CACHES = (
    "results.reading.speedups._speedups_cache",
    "results.reading.speedups._front_cache",
    "results.reading.transferring.tables._cache",
    "results.reading.devices._devices_cache",
    "dashboard.content.points._measured_cache",
)


@pytest.fixture(autouse=True)
def nothing_is_cached(monkeypatch: pytest.MonkeyPatch) -> None:
    """And revisions of another test's database mean other figures."""
    for cache in CACHES:
        monkeypatch.setattr(f"crowd.{cache}", VersionedCache(8))
