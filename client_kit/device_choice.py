"""Which device of which backend measures: the fastest that works here."""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from client_kit import drivers
from client_kit.errors import CannotMeasureError, UsageError
from slam.devices.choice import NAMES, choose_device, list_devices
from slam.devices.device import BACKENDS, Device, NoDeviceError

# From fast to slow. Of two devices of one kind that over OpenCL comes first.
KINDS = ("gpu", "accelerator", "other", "cpu")


def backends_for(application: str, wanted: str | None = None) -> tuple[str, ...]:
    """The backends that APPLICATION runs on, or WANTED alone.

    Raises UsageError where it does not run on WANTED.
    """
    from slam.systems import definition

    backends = definition(application).backends
    if wanted is None:
        return backends
    if wanted not in backends:
        raise UsageError(f"--backend {wanted}: {application} runs on {' and '.join(backends)} only")
    return (wanted,)


def present(backends: Sequence[str] = BACKENDS) -> list[Device]:
    """The devices of BACKENDS, fastest first. A backend without its package or driver has none."""
    return _ranked([device for backend in backends for device in _listed(backend)])


def choose(text: str | None = None, backends: Sequence[str] = BACKENDS, root: Path = Path("/")) -> Device:
    """The fastest device of BACKENDS, or the fastest whose label contains TEXT (case does not matter).

    Raises CannotMeasureError, which says what is present or what would help.
    """
    found: list[Device] = []
    matching: list[Device] = []
    for backend in backends:
        found += _listed(backend)
        matching = [device for device in found if (text or "").lower() in device.label.lower()]
        if any(device.kind == KINDS[0] for device in matching):
            break  # nothing that follows is faster, and looking for it may load another driver
    if matching:
        return _ranked(matching)[0]
    if found:
        names = " or ".join(NAMES[backend] for backend in backends)
        labels = "; ".join(device.label for device in found)
        raise CannotMeasureError(f"no {names} device matches {text!r}; present: {labels}")
    try:
        return choose_device(backend=backends[0])
    except (NoDeviceError, ImportError) as error:
        opencl = backends[0] == "opencl"
        raise CannotMeasureError(drivers.remedy(error, root) if opencl else str(error)) from error


def _ranked(devices: list[Device]) -> list[Device]:
    return sorted(devices, key=lambda device: (KINDS.index(device.kind), BACKENDS.index(device.backend)))


def _listed(backend: str) -> list[Device]:
    try:
        if backend == "opencl":
            return list_devices(backend)
        with _silenced():
            return list_devices(backend)
    except ImportError:
        return []


@contextmanager
def _silenced() -> Iterator[None]:
    """Nothing is written to standard error: graphics drivers complain there of windows that nobody needs."""
    sys.stderr.flush()
    kept = os.dup(2)
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 2)
        os.close(nowhere)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
