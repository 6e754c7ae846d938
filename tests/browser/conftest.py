"""A real Chromium, where one is installed, and a real server with rows that came in through the API."""

import os
from collections.abc import Iterator
from typing import Any

import pytest

from tests.browser.chromium import NoBrowserError, launched
from tests.browser.firefox import firefox
from tests.crowd.conftest import pack
from tests.server import *  # noqa: F403 - its fixtures

__all__ = ["firefox", "pack"]

# WebGPU on the processor, and a name that is not localhost: browsers trust that one without HTTPS.
FLAGS = (
    "--enable-unsafe-webgpu",
    "--use-webgpu-adapter=swiftshader",
    "--host-resolver-rules=MAP lab.test 127.0.0.1",
)


@pytest.fixture(scope="package")
def chromium() -> Iterator[Any]:
    """The installed browser, started once; a skip with its reason where there is none."""
    # Playwright runs an event loop in this thread, under which Django would refuse to touch the database.
    os.environ["DJANGO_ALLOW_ASYNC_UNSAFE"] = "1"
    try:
        with launched(*FLAGS) as browser:
            yield browser
    except NoBrowserError as reason:
        pytest.skip(str(reason))
    finally:
        del os.environ["DJANGO_ALLOW_ASYNC_UNSAFE"]
