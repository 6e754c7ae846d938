"""Choosing the measuring device: the fastest that works here."""

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from client_kit.device import drivers
from client_kit.errors import CannotMeasureError, UsageError
from slam import child_process
from slam.devices.choice import NAMES, choose_device, list_devices, remedy
from slam.devices.device import BACKENDS, Device, NoDeviceError

# From fast to slow. Of two devices of one kind, OpenCL comes first.
KINDS = ("gpu", "accelerator", "other", "cpu")
# A driver may abort or hang when it opens a device: the trial has its own process.
TRIAL = (
    "import sys\n"
    "from slam.devices.choice import choose_device, open_session\n"
    "open_session(choose_device(*sys.argv[1:]))\n"
)
TRIAL_SECONDS = 60


def backends_for(application: str, wanted: str | None = None) -> tuple[str, ...]:
    """The backends that `application` runs on, or only `wanted`.

    Raises UsageError where it does not run on `wanted`.
    """
    from slam.definitions import definition

    backends = definition(application).backends
    if wanted is None:
        return backends
    if wanted not in backends:
        raise UsageError(f"{application} runs on {' and '.join(backends)} only, not on {wanted}")
    return (wanted,)


def present(backends: Sequence[str] = BACKENDS) -> list[Device]:
    """The devices of `backends`, fastest first. A backend without its package or driver has none."""
    return _ranked([device for backend in backends for device in _listed(backend)])


def choose(text: str | None = None, backends: Sequence[str] = BACKENDS, root: Path = Path("/")) -> Device:
    """The fastest device of `backends`, or the fastest whose label contains `text` (case does not matter).

    With several `backends`, a WebGPU device that does not open is skipped if there is another one: a graphics
    driver may list an adapter and refuse it.

    Raises CannotMeasureError, which lists the devices or a remedy.
    """
    devices: list[Device] = []
    matching: list[Device] = []
    for backend in backends:
        devices += _listed(backend)
        matching = [device for device in devices if (text or "").lower() in device.label.lower()]
        if any(device.kind == KINDS[0] for device in matching):
            break  # no later device is faster, and the search may load another driver
    if matching:
        return _first_that_opens(_ranked(matching)) if len(backends) > 1 else _ranked(matching)[0]
    if devices:
        *others, last = (NAMES[backend] for backend in backends)
        names = f"{', '.join(others)} or {last}" if others else last
        labels = "; ".join(device.label for device in devices)
        raise CannotMeasureError(f"no {names} device matches {text!r}; present: {labels}")
    try:
        return choose_device(backend=backends[0])
    except NoDeviceError as error:
        missing = error.__cause__ if isinstance(error.__cause__, ImportError) else error
        text = drivers.remedy(missing, root) if backends[0] == "opencl" else str(error)
        if "wasm" in backends[1:]:
            text += f"; or {remedy('wasm')}"
        raise CannotMeasureError(text) from error


def _first_that_opens(devices: Sequence[Device]) -> Device:
    """The first of `devices` that is not WebGPU, or opens; else the first: its failure gives the reason."""
    if len(devices) == 1:
        return devices[0]
    opening = (device for device in devices if device.backend != "webgpu" or _opens(device))
    return next(opening, devices[0])


def _opens(device: Device) -> bool:
    command = [sys.executable, "-c", TRIAL, device.label, device.backend]
    try:
        done = subprocess.run(command, cwd=child_process.ROOT, capture_output=True, timeout=TRIAL_SECONDS)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0


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
    """Silence standard error, where graphics drivers report missing windows."""
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
