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
TOGETHER = {
    # It runs other tests on a database of its own.
    "on PostgreSQL": ("tests/services/test_same_on_postgresql.py",),
    # They start servers, workers and browsers, and wait for them: one after another, beside the rest.
    "services": ("tests/services/",),
    "browsers": ("tests/browser/",),
    # They share what is built for a session.
    "guide and wheel": (
        "tests/client_kit/test_arm64.py",
        "tests/client_kit/test_footprint.py",
        "tests/docs/test_site.py",
        "tests/test_installation.py",
    ),
}


def together(nodeid: str) -> str | None:
    """The name in TOGETHER of those that `nodeid` runs with, None where it runs with its file."""
    return next((name for name, places in TOGETHER.items() if nodeid.startswith(places)), None)


class ByRoom(LoadScopeScheduling):
    """Where pytest-xdist spreads the tests: those of TOGETHER in one process each, the others by file."""

    def __init__(self, config: pytest.Config, log: Any) -> None:
        super().__init__(config, log)
        config.option.loadscopereorder = False  # the order is that of the items

    def _split_scope(self, nodeid: str) -> str:
        return together(nodeid) or nodeid.split("::")[0]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what is SLOW. Begin with what takes longest, so that all processes end at about the same time."""
    for item in items:
        if item.nodeid.startswith(SLOW):
            item.add_marker(pytest.mark.slow)
    order = [*TOGETHER, None]
    items.sort(key=lambda item: order.index(together(item.nodeid)))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> ByRoom:
    return ByRoom(config, log)


@pytest.fixture(scope="session")
def guide(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The guide's pages, built once."""
    return documentation.build(tmp_path_factory.mktemp("guide"))


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory, guide: Path) -> Path:
    """The project's wheel with the guide in it, built once."""
    return build(tmp_path_factory.mktemp("wheel"), guide)
