"""Endpoints of clients: enrol, submit, and read the state of a submission."""

import re
from uuid import UUID

from django.http import HttpResponse
from drf_spectacular.utils import OpenApiParameter, extend_schema
from rest_framework.request import Request

from crowd.access import limits
from crowd.access.addresses import address_of, network_hash
from crowd.demo.mark import REFUSAL, refuses_clients
from crowd.devices.authentication import InstallationEndpoint, installation_of_request
from crowd.devices.services import enrol
from crowd.fronts import intake_policy
from crowd.http.api import Endpoint, json_response, read_body
from crowd.http.problems import Problem, not_found
from crowd.results import tasks
from crowd.results.api import responses
from crowd.results.figures import dry_run
from crowd.results.intake import schema, storing
from crowd.results.intake.daily_limits import Sender
from crowd.results.privacy.own_page import own_page_path
from crowd.results.reading import selectors
from wire.session import Enrolment, Submission

IDEMPOTENCY_KEY = re.compile(r"[\x21-\x7e]{1,128}")


class EnrolView(Endpoint):
    """A new, anonymous installation."""

    throttle_classes = [limits.Enrolments]

    @extend_schema(
        operation_id="enrol",
        summary="A token for a new, anonymous installation",
        request={"application/json": Enrolment},
        responses={201: responses.Enrolled},
    )
    def post(self, request: Request) -> HttpResponse:
        if refuses_clients():
            raise Problem("demo_server", REFUSAL)
        enrolment = schema.decode_enrolment(read_body(request))
        holding = intake_policy.current()
        storing.refuse_outdated(enrolment.app_version, holding)
        storing.refuse_other_consent(enrolment.consent_version, holding)
        installation, token = enrol(
            enrolment.app, enrolment.app_version, enrolment.consent_version, network_hash(request)
        )
        return json_response(responses.Enrolled(installation.pk, token), 201, {"Cache-Control": "no-store"})


class SubmissionsView(InstallationEndpoint):
    """Submissions of measured sessions."""

    throttle_classes = [limits.Submissions]

    @extend_schema(
        operation_id="submit",
        summary="Send measured sessions, at most 50 runs",
        description=(
            "Each run is checked separately; 422 means that all were rejected. The same key and body get the "
            "same response again, with 200, and change nothing. The body may be gzipped."
        ),
        parameters=[
            OpenApiParameter("Idempotency-Key", str, OpenApiParameter.HEADER, required=True),
            OpenApiParameter("Content-Encoding", str, OpenApiParameter.HEADER, enum=["gzip"]),
        ],
        request={"application/json": Submission},
        responses={200: responses.Accepted, 202: responses.Accepted},
    )
    def post(self, request: Request) -> HttpResponse:
        key = request.headers.get("Idempotency-Key", "")
        if not IDEMPOTENCY_KEY.fullmatch(key):
            raise Problem(
                "idempotency_key_missing",
                "send Idempotency-Key: 1 to 128 printable characters, new for each body",
                field="Idempotency-Key",
            )
        acceptance = storing.accept_submission(_sender(request), key, read_body(request))
        tasks.announce(acceptance.sessions)
        status = 200 if acceptance.replayed else 202
        return HttpResponse(acceptance.answer, status=status, content_type="application/json")


class ValidationView(InstallationEndpoint):
    """A dry run of a submission."""

    throttle_classes = [limits.Submissions]

    @extend_schema(
        operation_id="validate",
        summary="Check a submission without storing it",
        request={"application/json": Submission},
        responses={200: responses.Checked},
    )
    def post(self, request: Request) -> HttpResponse:
        checked = storing.validate_submission(_sender(request), read_body(request))
        items = [item.answer() for item in checked.items]
        judgements = dry_run.judge(checked, installation_of_request(request).pk)
        return json_response({"items": items, "judged": responses.judged(judgements)})


class SubmissionView(InstallationEndpoint):
    """The state of a submission."""

    @extend_schema(
        operation_id="submission",
        summary="The state of a submission",
        responses={200: responses.SubmissionState},
    )
    def get(self, request: Request, key: UUID) -> HttpResponse:
        installation = installation_of_request(request)
        state = selectors.submission(installation, key)
        if state is None:
            raise not_found(f"this installation sent no submission {key}")
        return json_response(responses.submission(state, own_page_path(installation)))


def _sender(request: Request) -> Sender:
    return Sender(installation_of_request(request), address_of(request), network_hash(request))
