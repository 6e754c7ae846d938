"""The Chromium that is installed on this machine, driven by Playwright."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
# Without them the browser itself speaks to other hosts.
FLAGS = (
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


REQUIRED = os.environ.get("FRONTRUNNER_BROWSERS") == "required"  # then a missing one is an error


class NoBrowserError(Exception):
    """There is no browser to drive; the message says what was looked for."""


def no_browser(reason: str) -> Exception:
    """What to raise: tests are skipped at a NoBrowserError alone."""
    return AssertionError(reason) if REQUIRED else NoBrowserError(reason)


@contextmanager
def launched(*more: str) -> Iterator[Any]:
    """A running browser, started with `more` flags too. Raises NoBrowserError where none, or no Playwright,
    is installed.
    """
    executable = next((path for name in NAMES if (path := shutil.which(name))), None)
    if executable is None:
        raise no_browser(f"no browser: none of {', '.join(NAMES)} is on the PATH")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError as error:
        raise no_browser("playwright is not installed") from error
    # Chromium's sandbox refuses to run as root.
    flags = [*FLAGS, *more, *(["--no-sandbox"] if os.geteuid() == 0 else [])]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=flags)
        try:
            yield browser
        finally:
            browser.close()
