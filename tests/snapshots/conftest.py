"""The option that writes snapshots again."""

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--write-snapshots", action="store_true", help="store the answers as they are now")
