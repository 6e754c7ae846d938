"""Device cookies: a browser that logged in to an account before is known to the server.

OWASP describes them in "Slow Down Online Guessing Attacks with Device Cookies". Failed log-ins of strangers
do not lock out a browser that has the cookie of the account. The cookie holds the account's name and a random
number, signed. It does not replace the password.
"""

import secrets
from dataclasses import dataclass

from django.conf import settings
from django.core import signing
from django.http import HttpRequest, HttpResponse
from django.urls import reverse
from django.utils.crypto import salted_hmac

SALT = "device cookie"
LIFETIME_SECONDS = 180 * 24 * 3600


@dataclass(frozen=True)
class DeviceCookie:
    """The cookie of one browser for one account; `number` is random and new with each log-in."""

    account: str
    number: str


def find(request: HttpRequest, account: str) -> DeviceCookie | None:
    """The valid device cookie that `request` carries for `account`, or None."""
    try:
        owner, number = signing.loads(
            request.COOKIES.get(cookie_name(account), ""), salt=SALT, max_age=LIFETIME_SECONDS
        )
    except (signing.BadSignature, ValueError, TypeError):
        return None
    return DeviceCookie(owner, number) if owner == account else None


def set_cookie(response: HttpResponse, account: str) -> None:
    """Mark the browser as known for `account`, which has just logged in."""
    response.set_cookie(
        cookie_name(account),
        signing.dumps([account, secrets.token_hex(16)], salt=SALT),
        max_age=LIFETIME_SECONDS,
        path=reverse("admin:index"),
        secure=settings.SESSION_COOKIE_SECURE,
        httponly=True,
        samesite="Strict",
    )


def cookie_name(account: str) -> str:
    """The cookie's name: one per account, because accounts may share a browser.

    It does not reveal the account.
    """
    return f"device_{salted_hmac(SALT, account).hexdigest()[:16]}"
