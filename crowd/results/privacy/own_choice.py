"""Whether a participant's model is named in public however rare it is, changed without a measurement."""

from crowd.devices.models import DeviceModel, Installation
from crowd.devices.services import choose_disclosure
from crowd.http.problems import Problem
from crowd.results.privacy.disclosure import sync_disclosure


def choose(installation: Installation, show_model: bool) -> None:
    """Store the choice of INSTALLATION. Pages follow at once, and so do files of the open data.

    Raises Problem 429 where the name would be shown again within the hour.
    """
    wait = choose_disclosure(installation, show_model)
    if wait:
        text = "the name was shown within the last hour: show it again later, hide it at any time"
        raise Problem(429, "too_many_requests", text, field="show_model", retry_after=wait)
    rare = DeviceModel.objects.filter(sessions__installation=installation, rare=True)
    sync_disclosure(rare.order_by("pk").values_list("pk", flat=True).distinct())
