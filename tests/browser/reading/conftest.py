"""A site that is filled once; the tests of this folder read it, each within a transaction of its own."""

from collections.abc import Iterator
from typing import Any

import pytest

from tests.browser.reading.site import Site, running


@pytest.fixture(autouse=True)
def own_data_folder() -> None:
    """The site has one of its own."""


@pytest.fixture(scope="package")
def site(
    chromium: Any, django_db_setup: None, django_db_blocker: Any, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Site]:
    """One filled server for all tests of this folder, which only read."""
    with django_db_blocker.unblock(), running(tmp_path_factory.mktemp("site")) as filled:
        yield filled
