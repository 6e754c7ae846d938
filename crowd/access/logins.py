"""The administration's log-in: limits on attempts, and one-time passwords.

Attempts are counted across processes. A browser that logged in to the account before has a limit of its own
(crowd.access.device_cookies). All others share the limits of their address, their network and the account:
strangers can exhaust the limit of an account, but cannot lock out a known browser.

An account that has a device for one-time passwords (RFC 6238) must always give one; with
FRONTRUNNER_REQUIRE_TOTP every account needs a device, which `manage.py totp USER` makes.
"""

import math
from typing import Any

from django import forms
from django.conf import settings
from django.contrib.admin import AdminSite
from django.contrib.admin.forms import AdminAuthenticationForm
from django.http import HttpRequest, HttpResponse
from django_otp import match_token, user_has_device

from crowd.access import counters, device_cookies
from crowd.access.addresses import address_of, is_this_machine, network_hash

WINDOW_SECONDS = 900
# Attempts in a window, successful or not.
TRIES_OF_KNOWN_BROWSER = 10
TRIES_OF_ADDRESS_AT_ACCOUNT, TRIES_OF_ADDRESS, TRIES_OF_NETWORK, TRIES_AT_ACCOUNT = 10, 30, 60, 100


class LogInForm(AdminAuthenticationForm):
    """Name, password and, for accounts with a device, its one-time password.

    `wait` is the seconds to wait after too many attempts, 0 otherwise.
    """

    otp_token = forms.CharField(
        label="One-time code",
        required=False,
        help_text="only for accounts that have set it up",
        widget=forms.TextInput(attrs={"autocomplete": "one-time-code", "inputmode": "numeric"}),
    )
    wait = 0

    def clean(self) -> dict[str, Any]:
        """Raises ValidationError after too many attempts, or for a wrong password or one-time password."""
        name = self.cleaned_data.get("username")
        if name and self.request is not None:
            self.wait = seconds_to_wait(self.request, name)
        if self.wait:
            minutes = math.ceil(self.wait / 60)
            raise forms.ValidationError(f"Too many tries: wait {minutes} minutes.", code="too_many_tries")
        cleaned: dict[str, Any] = super().clean()
        user: Any = self.get_user()
        if user is not None and (settings.FRONTRUNNER_REQUIRE_TOTP or user_has_device(user)):
            token = cleaned.get("otp_token")
            # django-otp then marks the session as verified.
            user.otp_device = match_token(user, token) if token else None
            if user.otp_device is None:
                raise forms.ValidationError(
                    "The one-time password is missing, wrong or used already.", code="one_time_password"
                )
        return cleaned


class LogInSite(AdminSite):
    """An admin site with limits on log-in attempts and one-time passwords."""

    site_header = site_title = "Frontrunner"
    index_title = "Administration"
    login_form = LogInForm
    login_template = "admin/log_in.html"

    def login(self, request: HttpRequest, extra_context: dict[str, Any] | None = None) -> HttpResponse:
        """The log-in page; 429 after too many attempts. A log-in marks the browser as known."""
        response = super().login(request, extra_context)
        if request.method == "POST" and response.status_code == 302 and request.user.is_authenticated:
            device_cookies.set_cookie(response, request.user.get_username())
        wait = getattr((getattr(response, "context_data", None) or {}).get("form"), "wait", 0)
        if wait:
            response.status_code = 429
            response["Retry-After"] = str(wait)
        return response

    def has_permission(self, request: HttpRequest) -> bool:
        """Whether the account is staff and gave a one-time password if it needs one."""
        if not super().has_permission(request):
            return False
        user: Any = request.user
        needed = settings.FRONTRUNNER_REQUIRE_TOTP or user_has_device(user)
        return not needed or bool(user.is_verified())


def seconds_to_wait(request: HttpRequest, account: str) -> int:
    """Count one attempt to log in to `account`; return 0 if it is allowed, otherwise the seconds to wait.

    The limits are checked in order. An attempt that one limit refuses is not counted by the following ones:
    one address cannot exhaust its network, and one network cannot exhaust the account. The counters hold
    keyed hashes, for a day at most.
    """
    with counters.tolerate_failure("attempts to log in"):
        for key, most in _limits(request, account):
            count = counters.count(f"login:{key}", WINDOW_SECONDS)
            if count.used > most:
                return math.ceil(count.resets_in)
    return 0


def _limits(request: HttpRequest, account: str) -> list[tuple[str, int]]:
    """The counters of this attempt, each with how many attempts it allows."""
    hashed = counters.hmac_identifier
    cookie = device_cookies.find(request, account)
    if cookie is not None:
        return [(f"browser:{hashed(cookie.number)}", TRIES_OF_KNOWN_BROWSER)]
    address = address_of(request)
    limits = [
        (f"{hashed(address)}:{hashed(account)}", TRIES_OF_ADDRESS_AT_ACCOUNT),
        (hashed(address), TRIES_OF_ADDRESS),
        (f"network:{hashed(network_hash(request) or address)}", TRIES_OF_NETWORK),
    ]
    if not is_this_machine(request):
        limits.append((f":{hashed(account)}", TRIES_AT_ACCOUNT))
    return limits
