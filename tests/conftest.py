"""Keeps every test away from the data folder of a server that its developer may be running."""

from pathlib import Path
from typing import Any

import hypothesis
import pytest

from crowd.celery import app

# How fast a loaded machine makes up examples says nothing of the code.
hypothesis.settings.register_profile(
    "patient", deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile("patient")
# Tasks run where they are sent, and no message reaches a worker outside the tests.
app.conf.update(task_always_eager=True, task_eager_propagates=True, broker_url="memory://")


ROOT = Path(__file__).parent
# Their tests start servers, workers and browsers, and wait for them: one after another, beside the rest.
ONE_BY_ONE = ("services", "browser")


@pytest.hookimpl(tryfirst=True)  # pytest-xdist reads the groups in the same hook
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Where pytest-xdist spreads the tests: those that start programs in one process, the others by file.

    The former come first, because they take longest.
    """

    def room(item: pytest.Item) -> str:
        return item.path.relative_to(ROOT).parts[0]

    for item in items:
        group = "programs" if room(item) in ONE_BY_ONE else str(item.path)
        item.add_marker(pytest.mark.xdist_group(group))
    items.sort(key=lambda item: room(item) not in ONE_BY_ONE)


@pytest.fixture(autouse=True)
def own_data_folder(settings: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An empty data folder; static files from their sources; sequences only where a test puts them."""
    folder = tmp_path_factory.mktemp("var")
    settings.FRONTRUNNER_VAR = folder
    # Tests name the devices they measure, once each. What becomes of rare ones has tests of its own.
    settings.FRONTRUNNER_RARE_BELOW = 1
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
    monkeypatch.setattr("crowd.results.intake._released", {})
