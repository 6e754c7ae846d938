"""Reads of results: what pages and the API show. Every figure comes from summaries, never from raw times."""

from crowd.results.reading.backends import side_by_side
from crowd.results.reading.crowd import (
    Speedups,
    attempts,
    breakdown,
    group_of,
    headline,
    model_speedups,
    place,
)
from crowd.results.reading.devices import device, devices, pending
from crowd.results.reading.history import history
from crowd.results.reading.newest_times import newest_times
from crowd.results.reading.queries.parsing import UnknownFrontError, asked
from crowd.results.reading.search import search
from crowd.results.reading.sessions import (
    LISTED_SESSIONS,
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
    "asked",
    "attempts",
    "breakdown",
    "device",
    "devices",
    "group_of",
    "headline",
    "history",
    "latest_sessions",
    "measured_front",
    "model_speedups",
    "newest_times",
    "own_sessions",
    "pending",
    "place",
    "run",
    "search",
    "session",
    "side_by_side",
    "speedups",
    "submission",
    "winners",
]
