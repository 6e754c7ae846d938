"""What a reference device measures on: it stays the same for as long as an exploration counts on it."""

from django.core.exceptions import ValidationError

from crowd.explorations.models import Exploration, ReferenceDevice

UNFINISHED = (Exploration.State.RUNNING, Exploration.State.PAUSED)


def check_change(device: ReferenceDevice, backend: str, wanted: str) -> None:
    """Raise ValidationError where DEVICE may not measure on BACKEND's device WANTED from now on.

    Runtimes on one device say nothing of those on another: half a search on each finds no front.
    """
    stored = ReferenceDevice.objects.filter(pk=device.pk).first()
    if stored is None or (stored.backend, stored.opencl_device) == (backend, wanted):
        return
    busy = device.explorations.filter(state__in=UNFINISHED).values_list("pk", flat=True).first()
    if busy is not None:
        raise ValidationError(
            f"{device} measures exploration {busy} on {_described(stored.backend, stored.opencl_device)}, so "
            f"it cannot change to {_described(backend, wanted)} now: wait until that is done or cancel it, "
            "or add another reference device"
        )


def change(device: ReferenceDevice, backend: str | None, wanted: str | None) -> None:
    """Let DEVICE measure on BACKEND's device WANTED from now on; None keeps what it has.

    Raises ValidationError as above.
    """
    backend = device.backend if backend is None else backend
    wanted = device.opencl_device if wanted is None else wanted
    check_change(device, backend, wanted)
    device.backend, device.opencl_device = backend, wanted
    device.save(update_fields=["backend", "opencl_device"])


def _described(backend: str, device: str) -> str:
    return f"{backend}, {device or 'its best device'}"
