"""Reads of results for pages and the API. Figures come from summaries, never from raw times."""

from crowd.results.reading.aggregates import Speedups
from crowd.results.reading.backends import backend_comparison
from crowd.results.reading.devices import device, devices, devices_without_figure
from crowd.results.reading.history import history
from crowd.results.reading.newest_times import newest_times
from crowd.results.reading.queries.parsing import UnknownFrontError, parse_filters
from crowd.results.reading.search import search
from crowd.results.reading.sessions import (
    LISTED_SESSIONS,
    latest_by_device,
    latest_sessions,
    own_sessions,
    run,
    session,
    submission,
)
from crowd.results.reading.speedups import measured_front, speedups
from crowd.results.reading.transferring.winners import winners

__all__ = [
    "LISTED_SESSIONS",
    "Speedups",
    "UnknownFrontError",
    "backend_comparison",
    "device",
    "devices",
    "devices_without_figure",
    "history",
    "latest_by_device",
    "latest_sessions",
    "measured_front",
    "newest_times",
    "own_sessions",
    "parse_filters",
    "run",
    "search",
    "session",
    "speedups",
    "submission",
    "winners",
]
