"""`doctor`: what of a measurement would work on this device now, and what stands against it."""

import platform
import sys
from collections.abc import Iterator
from pathlib import Path

from client_kit import __version__, device, drivers, preflight
from client_kit.errors import CannotMeasureError
from client_kit.home import Home


def examine(home: Home, root: Path = Path("/")) -> Iterator[str]:
    """Line by line; raises CannotMeasureError at the end where nothing can be measured."""
    yield f"Client {__version__}, Python {platform.python_version()} on {sys.platform}"
    yield f"State is kept in {home.path}"
    from slam.devices.choice import choose_device, list_devices
    from slam.devices.device import NoDeviceError

    try:
        best = choose_device()
    except (NoDeviceError, ImportError) as error:
        raise CannotMeasureError(drivers.remedy(error, root)) from error
    for number, found in enumerate(list_devices()):
        used = ", used unless --device names another" if number == 0 else ""
        yield f"OpenCL device: {found.label}, {found.global_memory >> 20} MiB{used}"
    yield "What the server would be told of this device:"
    told = device.identify(root, opencl=device.opencl_identity(best.handle))
    for name, value in told.items():
        yield f"  {name}: {'unknown' if value is None else value}"
    for reason in preflight.too_large({"": {"volume_resolution": 512}}, best, root).values():
        yield f"Note: {reason}; such configurations are recorded as failed"
    concerns = preflight.concerns(home, root)
    for concern in concerns:
        yield f"{'Stop' if concern.stops else 'Note'}: {concern.text}"
    stopping = [concern for concern in concerns if concern.stops]
    if stopping:
        raise CannotMeasureError(stopping[0].text)
    yield "This device can measure now."
