"""Sessions through the API, for pages to show."""

from typing import Any

from tests.builders.documents import (
    device_document,
    run_document,
    session_document,
    submission_document,
)
from tests.builders.participant import Participant


def measure(participant: Participant, model: str = "Pixel 8", **changes: Any) -> dict[str, Any]:
    """One session of a phone `model` through the API; the session as it was sent."""
    session = session_document(**changes)
    response = participant.submit(submission_document(session, device=device_document(model)))
    assert response.status_code == 202, response.content
    return session


def in_balanced_order(frame_us: dict[str, int]) -> list[dict[str, Any]]:
    """Two runs of each configuration of `frame_us`, forwards and then backwards, so that drift cancels."""
    last = 2 * len(frame_us) - 1
    runs = []
    for place, (name, microseconds) in enumerate(frame_us.items()):
        runs += [
            run_document(name, 0, place, microseconds),
            run_document(name, 1, last - place, microseconds),
        ]
    return sorted(runs, key=lambda run: run["order"])
