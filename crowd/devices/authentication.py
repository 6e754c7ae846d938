"""Authentication of installations by the token that enrolment gave them."""

from drf_spectacular.extensions import OpenApiAuthenticationExtension
from rest_framework.authentication import BaseAuthentication
from rest_framework.request import Request

from crowd.access import limits
from crowd.devices.models import Installation
from crowd.devices.services import installation_of
from crowd.http.api import Endpoint
from crowd.http.problems import Problem


class TokenAuthentication(BaseAuthentication):
    """`Authorization: Bearer TOKEN`; sets `request.auth` to the Installation."""

    accepts_revoked = False

    def authenticate(self, request: Request) -> tuple[None, Installation]:
        """Raises Problem 401 without a token, or with one that is unknown or revoked."""
        scheme, _, token = request.headers.get("Authorization", "").partition(" ")
        if not scheme:
            raise Problem("token_missing", "send Authorization: Bearer TOKEN; POST /api/v1/enrol gives one")
        installation = installation_of(token.strip()) if scheme.lower() == "bearer" else None
        if installation is None or (installation.revoked_at is not None and not self.accepts_revoked):
            raise Problem("token_invalid", "this token is unknown or was revoked: enrol again")
        return None, installation


class OptionalToken(TokenAuthentication):
    """A token is optional."""

    def authenticate(self, request: Request) -> tuple[None, Installation] | None:  # type: ignore[override]
        """Raises Problem 401 for a token that is unknown or revoked."""
        return super().authenticate(request) if "Authorization" in request.headers else None


class AnyTokenAuthentication(TokenAuthentication):
    """Accepts revoked tokens too, so that participants can always read and erase their data."""

    accepts_revoked = True


class TokenScheme(OpenApiAuthenticationExtension):
    """The token in the OpenAPI document."""

    target_class = TokenAuthentication
    name = "installation"

    def get_security_definition(self, auto_schema: object) -> dict[str, str]:  # noqa: ARG002
        return {"type": "http", "scheme": "bearer"}


class OptionalScheme(TokenScheme):
    """The optional token."""

    target_class = OptionalToken
    name = "installation_where_known"

    def get_security_requirement(self, auto_schema: object) -> list[dict[str, list[str]]]:  # noqa: ARG002
        return [{}, {self.name: []}]


class AnyTokenScheme(TokenScheme):
    """The token, revoked or not."""

    target_class = AnyTokenAuthentication
    name = "installation_also_revoked"


class InstallationEndpoint(Endpoint):
    """A view for installations with a token."""

    authentication_classes = [TokenAuthentication]
    throttle_classes = [limits.OwnRequests]


class DataRightsEndpoint(InstallationEndpoint):
    """A view for installations, also after their token was revoked."""

    authentication_classes = [AnyTokenAuthentication]


def installation_of_request(request: Request) -> Installation:
    """The installation that sent `request` to an InstallationEndpoint."""
    assert isinstance(request.auth, Installation)
    return request.auth
