"""Who asks: an installation is known by the token that enrolment gave it."""

from drf_spectacular.extensions import OpenApiAuthenticationExtension
from rest_framework.authentication import BaseAuthentication
from rest_framework.request import Request

from crowd.access import limits
from crowd.devices.models import Installation
from crowd.devices.services import installation_of
from crowd.http.api import Endpoint
from crowd.http.problems import Problem


class TokenAuthentication(BaseAuthentication):
    """`Authorization: Bearer TOKEN`; `request.auth` becomes the Installation."""

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
    """Anyone may ask; whoever sends a token is known by it."""

    def authenticate(self, request: Request) -> tuple[None, Installation] | None:  # type: ignore[override]
        """Raises Problem 401 for a token that is unknown or revoked."""
        return super().authenticate(request) if "Authorization" in request.headers else None


class RightsAuthentication(TokenAuthentication):
    """As TokenAuthentication, and a revoked token counts as well: participants keep access to their own data
    and may always erase it.
    """

    accepts_revoked = True


class TokenScheme(OpenApiAuthenticationExtension):
    """The token in the OpenAPI document."""

    target_class = TokenAuthentication
    name = "installation"

    def get_security_definition(self, auto_schema: object) -> dict[str, str]:  # noqa: ARG002
        return {"type": "http", "scheme": "bearer"}


class OptionalScheme(TokenScheme):
    """The token, where there is one."""

    target_class = OptionalToken
    name = "installation_where_known"

    def get_security_requirement(self, auto_schema: object) -> list[dict[str, list[str]]]:  # noqa: ARG002
        return [{}, {self.name: []}]


class RightsScheme(TokenScheme):
    """The token, revoked or not."""

    target_class = RightsAuthentication
    name = "installation_also_revoked"


class OwnEndpoint(Endpoint):
    """An address that an installation asks with its token."""

    authentication_classes = [TokenAuthentication]
    throttle_classes = [limits.OwnRequests]


class RightsEndpoint(OwnEndpoint):
    """The same, after the token was revoked as well."""

    authentication_classes = [RightsAuthentication]


def installation_asking(request: Request) -> Installation:
    """Whose request it is, at an OwnEndpoint."""
    assert isinstance(request.auth, Installation)
    return request.auth
