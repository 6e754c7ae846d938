"""A real Chromium, where one is installed, and a real server with rows that came in through the API."""

import os
from collections.abc import Iterator
from typing import Any

import pytest
from django.test import Client

from crowd.devices.services import enrol
from crowd.fronts.services import publish_content
from tests.browser.chromium import NoBrowserError, launched
from tests.browser.site import Site, running
from tests.crowd.conftest import pack
from tests.crowd.documents import device_document, front_document, session_document, submission_document
from tests.crowd.participant import Participant
from tests.dashboard import searches

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


@pytest.fixture(scope="package")
def site(
    chromium: Any, django_db_setup: None, django_db_blocker: Any, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Site]:
    """One filled server for all tests that only read. pytest-django runs them, which are marked django_db,
    before those that empty the database.
    """
    with django_db_blocker.unblock(), running(tmp_path_factory.mktemp("site")) as filled:
        yield filled


@pytest.fixture
def measured(transactional_db: None, pack: dict[str, Any]) -> list[dict[str, Any]]:
    """Five phones, one with a long name and one with three installations, and a search; sessions as sent."""
    publish_content(front_document(pack))
    searches.measure(searches.exploration(pack), searches.KNOWN)
    models = [
        "Pixel 8",
        "Pixel 8",
        "Pixel 8",
        "Pixel 7",
        "Redmi Note 12 Pro 5G Speed Edition Plus",
        "P30",
        "S21",
    ]
    sessions = []
    for number, model in enumerate(models):
        session = session_document(best_us=9_000 + 1_500 * number)
        _, token = enrol("client_kit", "0.1.0", 1)
        device = device_document(model, opencl_device="NVIDIA T4" if number == 5 else "Mali-G715")
        response = Participant(Client(), token, "").submit(submission_document(session, device=device))
        assert response.status_code == 202, response.content
        sessions.append(session)
    return sessions
