"""Requests made up from the OpenAPI document: none makes the server fail, or answer off its own document."""

from typing import Any

import hypothesis
import pytest
import schemathesis
from schemathesis import GenerationMode
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from crowd.explorations.models import Exploration
from crowd.explorations.tokens import issue_token
from crowd.openapi import document
from crowd.wsgi import application
from tests.crowd.documents import device_document, submission_document
from tests.crowd.participant import Participant
from tests.explorations.conftest import exploration, tiny_pack, unsaved  # noqa: F401 - fixtures

CHECKS = [
    not_a_server_error,
    status_code_conformance,
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
]
DOCUMENT = schemathesis.openapi.from_dict(document())
DOCUMENT.app = application
OPERATIONS = {operation.ok().label: operation.ok() for operation in DOCUMENT.get_all_operations()}
SEARCHING = hypothesis.settings(
    max_examples=20,
    deadline=None,
    derandomize=True,
    database=None,
    phases=[hypothesis.Phase.generate],
    suppress_health_check=list(hypothesis.HealthCheck),
)


@pytest.fixture
def tokens(participant: Participant, exploration: Exploration, settings: Any) -> dict[str, str]:  # noqa: F811
    """A server with a front, a submission and an exploration, without limits; a token for each scheme."""
    for name in (
        "READS_PER_MINUTE",
        "OWN_REQUESTS_PER_MINUTE",
        "SUBMISSIONS_PER_MINUTE",
        "ENROLMENTS_PER_HOUR",
    ):
        setattr(settings, f"FRONTRUNNER_{name}", 0)
    assert participant.submit(submission_document()).status_code == 202
    other = submission_document(device=device_document("Pixel 9"))
    assert participant.submit(other).status_code == 202
    return {"installation": participant.token, "reference_device": issue_token(exploration.reference_device)}


def headers(operation: Any, tokens: dict[str, str]) -> dict[str, str]:
    """The token that OPERATION asks for."""
    schemes = [name for scheme in operation.definition.raw.get("security", []) for name in scheme]
    return {"Authorization": f"Bearer {tokens[schemes[0]]}"} if schemes else {}


def cases(operation: Any) -> hypothesis.strategies.SearchStrategy[schemathesis.Case]:
    """Requests that fit the document, and where something can be wrong with them, others that do not."""
    fitting = operation.as_strategy(generation_mode=GenerationMode.POSITIVE)
    if not (operation.query or operation.body):
        return fitting
    return fitting | operation.as_strategy(generation_mode=GenerationMode.NEGATIVE)


@pytest.mark.parametrize("label", OPERATIONS)
def test_no_request_makes_the_server_fail(label: str, tokens: dict[str, str]) -> None:
    operation = OPERATIONS[label]

    @SEARCHING
    @hypothesis.given(cases(operation))
    def search(case: schemathesis.Case) -> None:
        case.call_and_validate(headers=headers(operation, tokens), checks=CHECKS)

    search()


def test_real_answers_are_as_described(
    tokens: dict[str, str],
    participant: Participant,
    exploration: Exploration,  # noqa: F811
) -> None:
    submission = participant.submit(submission_document()).json()["submission_id"]
    own = {"Authorization": f"Bearer {tokens['installation']}"}
    for path, places, query in (
        ("/manifest", {}, {}),
        ("/fronts", {}, {}),
        ("/fronts/{version}", {"version": "kfusion-test"}, {}),
        ("/speedups", {}, {"configuration": "all"}),
        ("/devices", {}, {"limit": "1"}),
        ("/devices/{slug}", {"slug": "google-pixel-8"}, {}),
        ("/compare", {}, {"devices": "google-pixel-8,google-pixel-9"}),
        ("/explorations", {}, {}),
        ("/explorations/{key}", {"key": str(exploration.pk)}, {}),
        ("/exports", {}, {}),
        ("/submissions/{key}", {"key": submission}, {}),
        ("/me/data", {}, {}),
    ):
        case = DOCUMENT[f"/api/v1{path}"]["GET"].Case(path_parameters=places, query=query)
        response = case.call_and_validate(headers=own, checks=CHECKS)
        assert response.status_code == 200, path
