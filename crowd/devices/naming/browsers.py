"""Names of browsers, derived from what pages send. Only listed names and numbers are used."""

import re

OTHER = "other"
# The first match counts: browsers built on Chromium also name Chrome.
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


def listed_name(line: str) -> str:
    """The browser that `line` names; OTHER if it is not listed, empty for an empty `line`."""
    return next((name for pattern, name in BROWSERS if pattern.search(line)), OTHER if line else "")


def major(version: str) -> str:
    """The major number of `version`; empty if it does not start with a number."""
    match = MAJOR.match(version)
    return match[0] if match else ""
