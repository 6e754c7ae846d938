"""What a reference device measures on: it stays the same for as long as an exploration counts on it."""

from django.core.exceptions import ValidationError

from crowd.explorations.models import Exploration, ReferenceDevice

UNFINISHED = (Exploration.State.RUNNING, Exploration.State.PAUSED)


def check_opencl_device(device: ReferenceDevice, wanted: str) -> None:
    """Raise ValidationError where DEVICE may not measure on the OpenCL device WANTED from now on.

    Runtimes on one OpenCL device say nothing of those on another: half a search on each finds no front.
    """
    stored = ReferenceDevice.objects.filter(pk=device.pk).first()
    if stored is None or stored.opencl_device == wanted:
        return
    busy = device.explorations.filter(state__in=UNFINISHED).values_list("pk", flat=True).first()
    if busy is not None:
        raise ValidationError(
            f"{device} measures exploration {busy} on {stored.opencl_device or 'the best OpenCL device'}, so "
            f"it cannot change to {wanted or 'the best one'} now: wait until that is done or cancel it, or "
            "add another reference device"
        )


def use_opencl_device(device: ReferenceDevice, wanted: str) -> None:
    """Let DEVICE measure on the OpenCL device WANTED from now on. Raises ValidationError as above."""
    check_opencl_device(device, wanted)
    device.opencl_device = wanted
    device.save(update_fields=["opencl_device"])
