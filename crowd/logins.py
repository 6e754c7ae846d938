"""Who gets into the administration: tries are counted across processes, one-time passwords where wanted.

An account that has a device for one-time passwords (RFC 6238) must always give one; with
FRONTRUNNER_REQUIRE_TOTP every account needs a device, which `manage.py totp USER` makes.
"""

import logging
import math
from typing import Any

from django import forms
from django.conf import settings
from django.contrib.admin import AdminSite
from django.contrib.admin.forms import AdminAuthenticationForm
from django.http import HttpRequest, HttpResponse
from django_otp import match_token, user_has_device

from crowd import counters
from crowd.limits import address_of

WINDOW_SECONDS = 900
# Tries in a window, right or wrong: of one address at one account, of one address, at one account. A try that
# an earlier one of these refuses is no try under the later ones: else one address could close an account.
TRIES_HERE, TRIES_OF_ADDRESS, TRIES_AT_ACCOUNT = 10, 30, 100

log = logging.getLogger(__name__)


class LogInForm(AdminAuthenticationForm):
    """Name, password and, for who has a device, its one-time password.

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
            self.wait = seconds_to_wait(address_of(self.request), name)
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
        """The log-in page; 429 after too many tries."""
        response = super().login(request, extra_context)
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


def seconds_to_wait(address: str, name: str) -> int:
    """Count one try to log in as NAME from ADDRESS; 0 where it may be made, else seconds until it may.

    Neither is stored: the counters know keyed hashes of them, for a day at most.
    """
    try:
        here, account = counters.disguised(address), counters.disguised(name)
        limits = {
            f"login:{here}:{account}": TRIES_HERE,
            f"login:{here}": TRIES_OF_ADDRESS,
            f"login::{account}": TRIES_AT_ACCOUNT,
        }
        for key, most in limits.items():
            count = counters.count(key, WINDOW_SECONDS)
            if count.used > most:
                return math.ceil(count.resets_in)
    except counters.CountingError as error:
        # Whoever administers must get in to a server with a full disk.
        log.warning("tries to log in are not counted now: %s", error)
    return 0
