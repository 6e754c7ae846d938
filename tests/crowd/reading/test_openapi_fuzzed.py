"""Requests made up from the OpenAPI document: none makes the server fail, or answer off its own document."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
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
from crowd.explorations import services
from crowd.explorations.measuring.tokens import issue_token
from crowd.fronts.publishing.services import publish_content
from crowd.results.models import Submission
from crowd.wsgi import application
from slam.datasets import open_sequence
from tests.builders import crowds, stored
from tests.builders.documents import front_document
from tests.builders.explorations import unsaved_exploration
from tests.explorations.conftest import tiny_pack  # noqa: F401 - a fixture

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
EXAMPLES = 20
# Their bodies take long to make up: fewer are, except in the exhaustive run.
LARGE = ("POST /api/v1/submissions", "POST /api/v1/submissions:validate")
SEARCHES = [
    *(pytest.param(label, 8 if label in LARGE else EXAMPLES, id=label) for label in OPERATIONS),
    *(pytest.param(label, EXAMPLES, id=f"{label} again", marks=pytest.mark.exhaustive) for label in LARGE),
]
SEARCHING = hypothesis.settings(
    deadline=None,
    derandomize=True,
    database=None,
    phases=[hypothesis.Phase.generate],
    suppress_health_check=list(hypothesis.HealthCheck),
)


@dataclass(frozen=True)
class Stored:
    """What all tests find, below `folders`: a front, two devices that measured it and an exploration; a token
    for each scheme."""

    tokens: dict[str, str]
    exploration: int
    folders: list[Path]


@pytest.fixture(scope="module")
def found(
    django_db_setup: None,
    django_db_blocker: Any,
    tmp_path_factory: pytest.TempPathFactory,
    tiny_pack: Path,  # noqa: F811
) -> Iterator[Stored]:
    folder = tmp_path_factory.mktemp("stored")
    folders = [folder / "sequences", tiny_pack.parent]
    with stored.filling(django_db_blocker, folder, FRONTRUNNER_SEQUENCES=folders) as pack:
        publish_content(front_document(pack))
        members = crowds.crowd(stored.join, {"Pixel 8": 8.0, "Pixel 9": 8.0})
        tiny = {"name": "tiny", "sha256": open_sequence(tiny_pack).sha256}
        exploration = services.create(unsaved_exploration(tiny))
        own = ("installation", "installation_also_revoked", "installation_where_known")
        tokens = dict.fromkeys(own, members[0].token)
        tokens["reference_device"] = issue_token(exploration.reference_device)
    yield Stored(tokens, exploration.pk, folders)
    with django_db_blocker.unblock():
        stored.empty()


@pytest.fixture
def tokens(found: Stored, db: None, settings: Any) -> Iterator[dict[str, str]]:
    """A server with what is stored, without limits; a token for each scheme.

    Requests share the test's connection, as with Django's own client, which would switch that off again.
    """
    for name in LIMITS:
        setattr(settings, name, 0)
    settings.FRONTRUNNER_SEQUENCES = found.folders
    for signal in (request_started, request_finished):
        signal.disconnect(close_old_connections)
    yield found.tokens
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
@pytest.mark.parametrize(("label", "examples"), SEARCHES)
def test_no_request_makes_the_server_fail(label: str, examples: int, tokens: dict[str, str]) -> None:
    operation = OPERATIONS[label]

    @hypothesis.settings(SEARCHING, max_examples=examples)
    @hypothesis.given(cases(operation))
    def search(case: schemathesis.Case) -> None:
        case.call_and_validate(headers=headers(operation, tokens), checks=CHECKS)

    search()


@pytest.mark.slow
def test_real_answers_are_as_described(tokens: dict[str, str], found: Stored) -> None:
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
        ("/explorations/{key}", {"key": str(found.exploration)}, {}),
        ("/exports", {}, {}),
        ("/submissions/{key}", {"key": str(submission.pk)}, {}),
        ("/me", {}, {}),
        ("/me/data", {}, {}),
        ("/models", {}, {"search": "iphone"}),
    ):
        case = DOCUMENT[f"/api/v1{path}"]["GET"].Case(path_parameters=places, query=query)
        response = case.call_and_validate(headers=own, checks=CHECKS)
        assert response.status_code == 200, path
