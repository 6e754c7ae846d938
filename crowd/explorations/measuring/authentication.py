"""Authenticates reference devices by the token that an administrator issued."""

from drf_spectacular.extensions import OpenApiAuthenticationExtension
from rest_framework.authentication import BaseAuthentication
from rest_framework.request import Request

from crowd.explorations.measuring.tokens import device_of_token
from crowd.explorations.models import ReferenceDevice
from crowd.http.api import Endpoint
from crowd.http.problems import Problem


class DeviceAuthentication(BaseAuthentication):
    """`Authorization: Bearer TOKEN`; `request.auth` becomes the ReferenceDevice."""

    def authenticate(self, request: Request) -> tuple[None, ReferenceDevice]:
        """Raises Problem 401 without a token, or with one that is unknown or was revoked."""
        scheme, _, token = request.headers.get("Authorization", "").partition(" ")
        if not scheme:
            raise Problem("token_missing", "send Authorization: Bearer TOKEN; an administrator issues it")
        device = device_of_token(token.strip()) if scheme.lower() == "bearer" else None
        if device is None:
            raise Problem(
                "token_invalid", "no reference device has this token: ask an administrator for a new one"
            )
        return None, device


class DeviceTokenScheme(OpenApiAuthenticationExtension):
    """Describes the token in the OpenAPI document."""

    target_class = DeviceAuthentication
    name = "reference_device"

    def get_security_definition(self, auto_schema: object) -> dict[str, str]:  # noqa: ARG002
        return {"type": "http", "scheme": "bearer"}


class DeviceEndpoint(Endpoint):
    """An endpoint for reference devices, with a token and without rate limits."""

    authentication_classes = [DeviceAuthentication]
    throttle_classes = []


def authenticated_device(request: Request) -> ReferenceDevice:
    """The reference device that sent `request` to a DeviceEndpoint."""
    assert isinstance(request.auth, ReferenceDevice)
    return request.auth
