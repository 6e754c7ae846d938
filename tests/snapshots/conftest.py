"""The option that writes snapshots again."""

import pytest

from tests.server import *  # noqa: F403 - its fixtures


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--write-snapshots", action="store_true", help="store the answers as they are now")
