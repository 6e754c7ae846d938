"""Browsers by the names people know, out of what pages send: listed names and numbers alone."""

import re
from collections.abc import Mapping
from typing import Any

from crowd.devices.naming.names import text

OTHER = "other"
# The first that matches; browsers built on Chromium name it too.
BROWSERS = tuple(
    (re.compile(pattern, re.IGNORECASE | re.ASCII), name)
    for pattern, name in (
        (r"\bedge\b|\bedg\b", "Edge"),
        (r"\bsamsung ?(internet|browser)\b", "Samsung Internet"),
        (r"\bopera\b|\bopr\b", "Opera"),
        (r"\bbrave\b", "Brave"),
        (r"\bvivaldi\b", "Vivaldi"),
        (r"\bduckduckgo\b", "DuckDuckGo"),
        (r"\bfirefox\b|\bfxios\b", "Firefox"),
        (r"\bandroid webview\b", "Android WebView"),
        (r"\b(google |headless)?chrome\b|\bcrios\b", "Chrome"),
        (r"\bchromium\b", "Chromium"),
        (r"\bsafari\b", "Safari"),
    )
)
MAJOR = re.compile(r"\d{1,3}(?!\d)", re.ASCII)


def known(line: str) -> str:
    """The listed browser that LINE names; OTHER for another one, empty for none."""
    return next((name for pattern, name in BROWSERS if pattern.search(line)), OTHER if line else "")


def major(version: str) -> str:
    """The first number of VERSION; empty where it does not begin with one."""
    found = MAJOR.match(version)
    return found[0] if found else ""


def is_browser(raw: Mapping[str, Any]) -> bool:
    """Whether RAW describes a device as a browser sees it."""
    return bool(text(raw, "browser") or text(raw, "gpu_vendor") or text(raw, "gpu_architecture"))
