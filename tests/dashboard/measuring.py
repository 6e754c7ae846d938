"""Sessions through the API, for pages to show."""

from typing import Any

from tests.crowd.documents import device_document, session_document, submission_document
from tests.crowd.participant import Participant


def measure(participant: Participant, model: str = "Pixel 8", **changes: Any) -> dict[str, Any]:
    """One session of a phone MODEL through the API; the session as it was sent."""
    session = session_document(**changes)
    response = participant.submit(submission_document(session, device=device_document(model)))
    assert response.status_code == 202, response.content
    return session
