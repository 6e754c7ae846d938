"""The administration's log-in: limits on tries, and one-time passwords.

Tries are counted across processes. A browser that logged in to the account before is counted alone
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
from crowd.access.addresses import address_of, is_this_machine, network_of

WINDOW_SECONDS = 900
# Tries in a window, right or wrong.
TRIES_OF_KNOWN_BROWSER = 10
TRIES_OF_ADDRESS_AT_ACCOUNT, TRIES_OF_ADDRESS, TRIES_OF_NETWORK, TRIES_AT_ACCOUNT = 10, 30, 60, 100


class LogInForm(AdminAuthenticationForm):
    """Name, password and, for accounts with a device, its one-time password.

    `wait` is how many seconds to wait after too many tries, 0 otherwise.
    """

    otp_token = forms.CharField(
        label="One-time code",
        required=False,
        help_text="only for accounts that have set it up",
        widget=forms.TextInput(attrs={"autocomplete": "one-time-code", "inputmode": "numeric"}),
    )
    wait = 0

    def clean(self) -> dict[str, Any]:
        """Raises ValidationError: too many tries, a wrong password, a missing or wrong one-time password."""
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
            # With it the log-in is remembered as verified.
            user.otp_device = match_token(user, token) if token else None
            if user.otp_device is None:
                raise forms.ValidationError(
                    "The one-time password is missing, wrong or used already.", code="one_time_password"
                )
        return cleaned


class Site(AdminSite):
    """The administration."""

    site_header = site_title = "Frontrunner"
    index_title = "Administration"
    login_form = LogInForm
    login_template = "admin/log_in.html"

    def login(self, request: HttpRequest, extra_context: dict[str, Any] | None = None) -> HttpResponse:
        """The log-in page; 429 after too many tries. A log-in makes the browser known."""
        response = super().login(request, extra_context)
        if request.method == "POST" and response.status_code == 302 and request.user.is_authenticated:
            device_cookies.give(response, request.user.get_username())
        wait = getattr((getattr(response, "context_data", None) or {}).get("form"), "wait", 0)
        if wait:
            response.status_code = 429
            response["Retry-After"] = str(wait)
        return response

    def has_permission(self, request: HttpRequest) -> bool:
        """Staff; with a one-time password where one is required of all, or the account has a device."""
        if not super().has_permission(request):
            return False
        user: Any = request.user
        needed = settings.FRONTRUNNER_REQUIRE_TOTP or user_has_device(user)
        return not needed or bool(user.is_verified())


def seconds_to_wait(request: HttpRequest, account: str) -> int:
    """Count one try of REQUEST to log in to ACCOUNT; 0 where it is allowed, else seconds until it is.

    The limits are checked in order, and a try that one refuses is not counted by those after it: one address
    cannot exhaust its network, and one network cannot exhaust the account. Nothing is stored: the counters
    have keyed hashes, for a day at most.
    """
    with counters.counting("tries to log in"):
        for key, most in _limits(request, account):
            count = counters.count(f"login:{key}", WINDOW_SECONDS)
            if count.used > most:
                return math.ceil(count.resets_in)
    return 0


def _limits(request: HttpRequest, account: str) -> list[tuple[str, int]]:
    """What counts this try, and how many tries each allows."""
    hidden = counters.disguised
    cookie = device_cookies.known(request, account)
    if cookie is not None:
        return [(f"browser:{hidden(cookie.number)}", TRIES_OF_KNOWN_BROWSER)]
    address = address_of(request)
    limits = [
        (f"{hidden(address)}:{hidden(account)}", TRIES_OF_ADDRESS_AT_ACCOUNT),
        (hidden(address), TRIES_OF_ADDRESS),
        (f"network:{hidden(network_of(request) or address)}", TRIES_OF_NETWORK),
    ]
    if not is_this_machine(request):
        limits.append((f":{hidden(account)}", TRIES_AT_ACCOUNT))
    return limits
