"""A real Chromium, where one is installed, and a real server with rows that came in through the API."""

import os
from collections.abc import Iterator
from typing import Any

import pytest

from tests.browser.chromium import NoBrowserError, launched
from tests.crowd.conftest import pack

__all__ = ["pack"]


@pytest.fixture(scope="package")
def chromium() -> Iterator[Any]:
    """The installed browser, started once; a skip with its reason where there is none."""
    # Playwright runs an event loop in this thread, under which Django would refuse to touch the database.
    os.environ["DJANGO_ALLOW_ASYNC_UNSAFE"] = "1"
    try:
        with launched() as browser:
            yield browser
    except NoBrowserError as reason:
        pytest.skip(str(reason))
    finally:
        del os.environ["DJANGO_ALLOW_ASYNC_UNSAFE"]
