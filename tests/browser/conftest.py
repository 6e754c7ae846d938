"""A real Chromium, where one is installed, and a real server with rows that came in through the API."""

import os
import shutil
from collections.abc import Iterator
from typing import Any

import pytest
from django.test import Client

from crowd.devices.services import enrol
from crowd.fronts.services import publish_content
from tests.crowd.conftest import pack
from tests.crowd.documents import device_document, front_document, session_document, submission_document
from tests.crowd.participant import Participant

__all__ = ["pack"]

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
# Without them the browser itself speaks to other hosts.
FLAGS = (
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """The installed browser, started once; a skip with its reason where there is none."""
    executable = next((path for name in NAMES if (path := shutil.which(name))), None)
    if executable is None:
        pytest.skip(f"no browser: none of {', '.join(NAMES)} is on the PATH")
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    # Playwright runs an event loop in this thread, under which Django would refuse to touch the database.
    os.environ["DJANGO_ALLOW_ASYNC_UNSAFE"] = "1"
    flags = [*FLAGS, "--no-sandbox"] if os.geteuid() == 0 else list(FLAGS)
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=flags)
        yield browser
        browser.close()
    del os.environ["DJANGO_ALLOW_ASYNC_UNSAFE"]


@pytest.fixture
def measured(transactional_db: None, pack: dict[str, Any]) -> list[dict[str, Any]]:
    """Five phones, one with a long name and one with three installations; their sessions as sent."""
    publish_content(front_document(pack))
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
