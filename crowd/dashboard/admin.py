"""Admin page for one-time passwords. Adding a device shows its secret once."""

from typing import Any

from django.contrib import admin
from django.http import HttpRequest, HttpResponse
from django_otp.plugins.otp_totp.admin import TOTPDeviceAdmin
from django_otp.plugins.otp_totp.models import TOTPDevice

# Importing TOTPDeviceAdmin registered it.
admin.site.unregister(TOTPDevice)


@admin.register(TOTPDevice)
class OneTimePasswordsAdmin(TOTPDeviceAdmin):  # type: ignore[misc]  # django-otp has no types
    """Devices for one-time passwords. Secrets of existing devices are not shown."""

    def get_fieldsets(self, request: HttpRequest, obj: TOTPDevice | None = None) -> Any:
        if obj is None:
            return [(None, {"fields": ["user", "name"]})]
        return super().get_fieldsets(request, obj)

    def response_add(
        self, request: HttpRequest, obj: TOTPDevice, post_url_continue: str | None = None
    ) -> HttpResponse:
        self.message_user(request, f"For the app, shown only now: {obj.config_url}")
        response: HttpResponse = super().response_add(request, obj, post_url_continue)
        return response
