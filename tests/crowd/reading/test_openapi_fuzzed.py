"""Requests made up from the OpenAPI document: none makes the server fail, or answer off its own document."""

from collections.abc import Callable, Iterator
from typing import Any

import hypothesis
import pytest
import schemathesis
from django.core.signals import request_finished, request_started
from django.db import close_old_connections
from schemathesis import GenerationMode
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from crowd.access.limits import Attempts, Enrolments, OwnRequests, Reads, Submissions
from crowd.api_pages.openapi import document
from crowd.explorations.measuring.tokens import issue_token
from crowd.explorations.models import Exploration
from crowd.results.models import Submission
from crowd.wsgi import application
from tests.builders.documents import device_document, submission_document
from tests.builders.participant import Participant
from tests.explorations.conftest import exploration, tiny_pack, unsaved  # noqa: F401 - fixtures

CHECKS = [
    not_a_server_error,
    status_code_conformance,
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
]


def has_a_documented_code(context: Any, response: Any, case: schemathesis.Case) -> None:
    """A refusal has one of the codes that its call's page lists."""
    if "problem+json" in (response.headers.get("content-type") or [""])[0]:
        code = response.json()["code"]
        assert code in case.operation.definition.raw["x-codes"], f"{case.operation.label}: {code}"


CHECKS.append(has_a_documented_code)
LIMITS = [limit.setting for limit in (Attempts, Reads, Enrolments, Submissions, OwnRequests)]
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
def tokens(
    participant: Participant,
    join: Callable[[], Participant],
    exploration: Exploration,  # noqa: F811
    settings: Any,
) -> Iterator[dict[str, str]]:
    """A server with a front, two devices and an exploration, without limits; a token for each scheme.

    Requests share the test's connection, as with Django's own client, which would switch that off again.
    """
    for name in LIMITS:
        setattr(settings, name, 0)
    for sender, model in ((participant, "Pixel 8"), (join(), "Pixel 9")):
        document = submission_document(device=device_document(model))
        assert sender.submit(document).status_code == 202
    reference = issue_token(exploration.reference_device)
    for signal in (request_started, request_finished):
        signal.disconnect(close_old_connections)
    yield {
        "installation": participant.token,
        "installation_also_revoked": participant.token,
        "installation_where_known": participant.token,
        "reference_device": reference,
    }
    for signal in (request_started, request_finished):
        signal.connect(close_old_connections)


def headers(operation: Any, tokens: dict[str, str]) -> dict[str, str]:
    """The token that `operation` asks for. Schemathesis reads plain answers of a WSGI application only."""
    schemes = [name for scheme in operation.definition.raw.get("security", []) for name in scheme]
    token = {"Authorization": f"Bearer {tokens[schemes[0]]}"} if schemes else {}
    return {"Accept-Encoding": "identity"} | token


def cases(operation: Any) -> hypothesis.strategies.SearchStrategy[schemathesis.Case]:
    """Requests that fit the document, and where something can be wrong with them, others that do not."""
    fitting = operation.as_strategy(generation_mode=GenerationMode.POSITIVE)
    if not (operation.query or operation.body):
        return fitting
    return fitting | operation.as_strategy(generation_mode=GenerationMode.NEGATIVE)


@pytest.mark.slow
@pytest.mark.parametrize("label", OPERATIONS)
def test_no_request_makes_the_server_fail(label: str, tokens: dict[str, str]) -> None:
    operation = OPERATIONS[label]

    @SEARCHING
    @hypothesis.given(cases(operation))
    def search(case: schemathesis.Case) -> None:
        case.call_and_validate(headers=headers(operation, tokens), checks=CHECKS)

    search()


@pytest.mark.slow
def test_real_answers_are_as_described(tokens: dict[str, str], exploration: Exploration) -> None:  # noqa: F811
    submission = Submission.objects.earliest("received_at")
    own = {"Accept-Encoding": "identity", "Authorization": f"Bearer {tokens['installation']}"}
    for path, places, query in (
        ("/manifest", {}, {}),
        ("/manifest", {}, {"minutes": "2"}),
        ("/recommendation", {}, {}),
        ("/fronts", {}, {}),
        ("/fronts/{version}", {"version": "kfusion-test"}, {}),
        ("/speedups", {}, {"configuration": "all"}),
        ("/devices", {}, {"limit": "1"}),
        ("/devices/{slug}", {"slug": "google-pixel-8"}, {}),
        ("/sessions", {}, {"limit": "1"}),
        ("/sessions/{key}", {"key": str(submission.sessions.get().uuid)}, {}),
        ("/runs", {}, {"limit": "3", "valid": "1"}),
        ("/compare", {}, {"devices": "google-pixel-8,google-pixel-9"}),
        ("/explorations", {}, {}),
        ("/explorations/{key}", {"key": str(exploration.pk)}, {}),
        ("/exports", {}, {}),
        ("/submissions/{key}", {"key": str(submission.pk)}, {}),
        ("/me", {}, {}),
        ("/me/data", {}, {}),
        ("/models", {}, {"search": "iphone"}),
    ):
        case = DOCUMENT[f"/api/v1{path}"]["GET"].Case(path_parameters=places, query=query)
        response = case.call_and_validate(headers=own, checks=CHECKS)
        assert response.status_code == 200, path
