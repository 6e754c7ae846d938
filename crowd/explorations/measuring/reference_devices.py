"""The backend and hardware of a reference device. They cannot change during an exploration."""

from django.core.exceptions import ValidationError

from crowd.explorations.models import Exploration, ReferenceDevice

THIS_MACHINE = "this-machine"  # the server itself as a reference device, and its queue
UNFINISHED = (Exploration.State.RUNNING, Exploration.State.PAUSED)


def create_this_machine() -> ReferenceDevice:
    """The reference device for this machine, created if it is missing."""
    return ReferenceDevice.objects.get_or_create(
        name=THIS_MACHINE, elsewhere="", defaults={"queue": THIS_MACHINE}
    )[0]


def check_change(device: ReferenceDevice, backend: str, wanted: str) -> None:
    """Raise ValidationError if `device` cannot change to `backend`'s device `wanted` now.

    Runtimes on different devices are not comparable within a search.
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


def change_device(device: ReferenceDevice, backend: str | None, wanted: str | None) -> None:
    """Change `device` to `backend`'s device `wanted`; None keeps the current value.

    Raises ValidationError as above.
    """
    backend = device.backend if backend is None else backend
    wanted = device.opencl_device if wanted is None else wanted
    check_change(device, backend, wanted)
    device.backend, device.opencl_device = backend, wanted
    device.save(update_fields=["backend", "opencl_device"])


def _described(backend: str, device: str) -> str:
    return f"{backend}, {device or 'its best device'}"
