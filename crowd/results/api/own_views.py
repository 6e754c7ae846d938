"""Endpoints of an installation about itself: its data, a new token, erasure."""

from uuid import UUID

import msgspec
from django.http import HttpResponse, HttpResponseBase, StreamingHttpResponse
from drf_spectacular.types import OpenApiTypes
from drf_spectacular.utils import extend_schema
from rest_framework.request import Request

from crowd.devices.authentication import DataRightsEndpoint, InstallationEndpoint, installation_of_request
from crowd.devices.models import Installation
from crowd.devices.services import renew_token
from crowd.http.api import json_response, read_body
from crowd.http.decoding import decode_body
from crowd.http.problems import not_found
from crowd.results.privacy import disclosure_choice, erasure
from crowd.results.privacy.own_data import own_data
from crowd.results.privacy.own_page import own_page_path

NO_STORE = {"Cache-Control": "no-store"}


class Token(msgspec.Struct):
    """A new token. It is shown only once."""

    token: str


class Own(msgspec.Struct):
    """An installation. `page`: the path of its private page, which names its model."""

    installation_id: UUID
    app: str
    app_version: str
    consent_version: int
    show_model: bool
    page: str


class Choice(msgspec.Struct):
    """Whether the device's model is named in public, even if it is rare."""

    show_model: bool


_CHOICE = msgspec.json.Decoder(Choice)


class OwnDataView(DataRightsEndpoint):
    """All stored data of the installation."""

    @extend_schema(
        operation_id="own_data",
        summary="All stored data of this installation",
        responses={200: OpenApiTypes.OBJECT},
    )
    def get(self, request: Request) -> HttpResponseBase:
        pieces = own_data(installation_of_request(request))
        return StreamingHttpResponse(pieces, content_type="application/json", headers=NO_STORE)


class OwnTokenView(InstallationEndpoint):
    """A new token."""

    @extend_schema(
        operation_id="renew_token",
        summary="A new token for this installation",
        description=(
            "The current token works until the new one is used for the first time. If the response is "
            "lost, ask again: only the newest token can replace the current one."
        ),
        request=None,
        responses={201: Token},
    )
    def post(self, request: Request) -> HttpResponse:
        return json_response(Token(renew_token(installation_of_request(request))), 201, NO_STORE)


class OwnView(DataRightsEndpoint):
    """The installation: its settings and its erasure."""

    @extend_schema(
        operation_id="own", summary="This installation and the path of its page", responses={200: Own}
    )
    def get(self, request: Request) -> HttpResponse:
        return _own(installation_of_request(request))

    @extend_schema(
        operation_id="choose",
        summary="Show or hide the device's model",
        description=(
            "Like `show_model` of a submission. A name can be hidden at any time, and shown again once an "
            "hour."
        ),
        request={"application/json": Choice},
        responses={200: Own},
    )
    def patch(self, request: Request) -> HttpResponse:
        installation = installation_of_request(request)
        disclosure_choice.set_show_model(installation, decode_body(_CHOICE, read_body(request)).show_model)
        return _own(installation)

    @extend_schema(
        operation_id="erase", summary="Erase this installation and all its data", responses={204: None}
    )
    def delete(self, request: Request) -> HttpResponse:
        erasure.erase_installation(installation_of_request(request))
        return HttpResponse(status=204)


class OwnRunView(DataRightsEndpoint):
    """Erasure of one run."""

    @extend_schema(operation_id="erase_run", summary="Erase one run", responses={204: None})
    def delete(self, request: Request, key: UUID) -> HttpResponse:
        if not erasure.erase_run(installation_of_request(request), key):
            raise not_found(f"this installation sent no run {key}")
        return HttpResponse(status=204)


def _own(installation: Installation) -> HttpResponse:
    answer = Own(
        installation.pk,
        installation.app,
        installation.app_version,
        installation.consent_version,
        installation.show_model,
        own_page_path(installation),
    )
    return json_response(answer, 200, NO_STORE)
