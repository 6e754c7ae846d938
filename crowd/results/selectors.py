"""Reads of results: what pages and the API show. Every figure comes from summaries, never from raw times."""

from crowd.results.reading.devices import device, devices
from crowd.results.reading.sessions import (
    LISTED_SESSIONS,
    latest_sessions,
    own_sessions,
    run,
    session,
    submission,
)
from crowd.results.reading.speedups import headline, measured_front, speedups

__all__ = [
    "LISTED_SESSIONS",
    "device",
    "devices",
    "headline",
    "latest_sessions",
    "measured_front",
    "own_sessions",
    "run",
    "session",
    "speedups",
    "submission",
]
