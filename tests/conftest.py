"""How the tests are spread, and what several packages of them build once. It needs no Django."""

from pathlib import Path
from typing import Any

import hypothesis
import pytest
from xdist.scheduler import LoadScopeScheduling

from tests import guide as documentation
from tests.wheel import build

pytest_plugins = ["tests.leaks"]

# How fast a loaded machine makes up examples says nothing of the code.
hypothesis.settings.register_profile(
    "patient", deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile("patient")

# Besides the tests that are marked themselves.
SLOW = ("tests/services/", "tests/browser/", "tests/docs/test_site.py", "tests/test_installation.py")
# They share what is built for a session.
TOGETHER = {
    "pages in a browser": ("tests/browser/reading/",),
    "guide and wheel": (
        "tests/client_kit/test_arm64.py",
        "tests/client_kit/test_footprint.py",
        "tests/docs/test_site.py",
        "tests/test_installation.py",
    ),
}
# What takes longest begins first, so that all processes end at about the same time.
FIRST = (
    "tests/services/test_explorations_survive.py",
    "tests/services/test_same_on_postgresql.py",
    "tests/services/",
    "tests/browser/measuring/",
    "tests/browser/",
    *TOGETHER["guide and wheel"],
    "tests/client_kit/web/",
    "tests/frontrunner/paper/",
)


def scope(nodeid: str) -> str:
    """What `nodeid` runs with in one process: those of TOGETHER, else the tests of its file."""
    shared = (name for name, places in TOGETHER.items() if nodeid.startswith(places))
    return next(shared, nodeid.split("::")[0])


class ByScope(LoadScopeScheduling):
    """How pytest-xdist spreads the tests."""

    def __init__(self, config: pytest.Config, log: Any) -> None:
        super().__init__(config, log)
        config.option.loadscopereorder = False  # the order is that of the items

    def _split_scope(self, nodeid: str) -> str:
        return scope(nodeid)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what is SLOW, and begin with what is FIRST."""
    for item in items:
        if item.nodeid.startswith(SLOW):
            item.add_marker(pytest.mark.slow)
    items.sort(key=lambda item: [not item.nodeid.startswith(place) for place in FIRST])


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> ByScope:
    return ByScope(config, log)


@pytest.fixture(scope="session")
def guide(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The guide's pages, built once."""
    return documentation.build(tmp_path_factory.mktemp("guide"))


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory, guide: Path) -> Path:
    """The project's wheel with the guide in it, built once."""
    return build(tmp_path_factory.mktemp("wheel"), guide)
