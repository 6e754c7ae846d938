"""Lets a participant choose, without a measurement, whether a rare model is named in public."""

from crowd.devices.models import DeviceModel, Installation
from crowd.devices.services import choose_disclosure
from crowd.http.problems import Problem
from crowd.results.privacy.disclosure_sync import sync_disclosure


def set_show_model(installation: Installation, show_model: bool) -> None:
    """Store the choice of `installation`. Pages and open data change at once.

    Raises Problem 429 if the name would be shown again within an hour.
    """
    wait = choose_disclosure(installation, show_model)
    if wait:
        text = "the name was shown within the last hour: show it again later, hide it at any time"
        raise Problem("too_many_requests", text, field="show_model", retry_after=wait)
    rare = DeviceModel.objects.filter(sessions__installation=installation, rare=True)
    sync_disclosure(rare.order_by("pk").values_list("pk", flat=True).distinct())
