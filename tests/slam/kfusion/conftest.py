"""Every OpenCL device present, and a way to run one kernel on NumPy arrays there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slam.opencl import Device, Session, list_devices

DEVICES = list_devices()


def _name(device: Device) -> str:
    return f"{device.kind}-{device.driver}".replace(" ", "-")


@pytest.fixture(scope="session", params=DEVICES or [None], ids=_name if DEVICES else ["none"])
def session(request: pytest.FixtureRequest) -> Session:
    if request.param is None:
        pytest.fail("no OpenCL device: PoCL's wheel is among the locked requirements where it exists")
    return Session(request.param)


@pytest.fixture
def launch(session: Session) -> Callable[..., None]:
    """launch(source, name, size, *arguments): arrays travel to the device and, changed, back in place."""
    import pyopencl as cl

    def run(source: Path, name: str, size: tuple[int, ...], *arguments: Any) -> None:
        places = {}
        for index, value in enumerate(arguments):
            if isinstance(value, np.ndarray) and not (value.dtype == np.float32 and value.shape == (4,)):
                places[index] = session.buffer(value.nbytes)
                cl.enqueue_copy(session.queue, places[index], value)
        bound = [places.get(index, value) for index, value in enumerate(arguments)]
        session.kernel(source, name, size, *bound)()
        for index, place in places.items():
            cl.enqueue_copy(session.queue, arguments[index], place)
        session.finish()

    return run
