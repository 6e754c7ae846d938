"""What the server makes of a device's strings."""

from typing import Any

from crowd.devices.models import DeviceDescription
from crowd.devices.recognition import recognise


def described(raw: dict[str, Any]) -> DeviceDescription:
    """The stored description of `raw`, and through it the model."""
    return DeviceDescription.objects.select_related("model").get(pk=recognise(raw).description)
