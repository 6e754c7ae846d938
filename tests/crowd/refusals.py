"""What tests ask of a refusal, and of what it leaves behind."""

from typing import Any

from crowd.devices.models import DeviceDescription, DeviceModel
from crowd.results.models import MeasurementSession, Run, Submission
from tests.builders.documents import session_document, submission_document


def nothing_is_stored() -> bool:
    return not any(
        model.objects.exists()
        for model in (Submission, MeasurementSession, Run, DeviceModel, DeviceDescription)
    )


def problem(response: Any) -> tuple[int, str, str | None]:
    """Status, code and field of a refusal, which must be problem+json and say something."""
    assert response.headers["Content-Type"] == "application/problem+json"
    document = response.json()
    assert document["status"] == response.status_code
    assert document["detail"]
    return response.status_code, document["code"], document.get("field")


def only(run: dict[str, Any]) -> dict[str, Any]:
    """A submission of this one run."""
    return submission_document(session_document(runs=[run]))


def nested(depth: int) -> list[Any]:
    """Lists in lists, so many."""
    lists: list[Any] = []
    for _ in range(depth - 1):
        lists = [lists]
    return lists
