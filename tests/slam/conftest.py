"""Every OpenCL device present, each build option, and a way to run one kernel on NumPy arrays there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import settings

from slam.devices.choice import list_devices, open_session
from slam.devices.layout import KINDS, Layout
from slam.devices.opencl import Session
from tests.slam.backends import built
from tests.slam.places import mark_exhaustive

# Examples of property tests are never judged by how long a busy machine takes for them.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

PLACES = [
    pytest.param((device, Layout(kind)), id=f"{device.kind}-{device.driver}-{kind}".replace(" ", "-"))
    for device in list_devices()
    for kind in KINDS
]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    folder = Path(__file__).parent
    mark_exhaustive(item for item in items if item.path.is_relative_to(folder))


@pytest.fixture(scope="session", params=[*PLACES, *built()] or [None])
def session(request: pytest.FixtureRequest) -> Session:
    """Every device, with the kernels laid out for CPUs and for GPUs, and each build option."""
    if request.param is None:
        pytest.fail("no OpenCL device: PoCL's wheel is among the locked requirements where it exists")
    session = open_session(*request.param)
    assert isinstance(session, Session)
    return session


@pytest.fixture
def launch(session: Session) -> Callable[..., None]:
    """launch(source, name, size, *arguments, group=None): arrays travel to the device and, changed, back.

    A size of ("image", width, height) is laid out as the session's images are.
    """

    def run(
        source: Path, name: str, size: Any, *arguments: Any, group: tuple[int, ...] | None = None
    ) -> None:
        if size[0] == "image":
            size, group = session.layout.over(*size[1:])
        places = {}
        for index, value in enumerate(arguments):
            if isinstance(value, np.ndarray) and not (value.dtype == np.float32 and value.shape == (4,)):
                places[index] = session.buffer(value.nbytes)
                session.upload(places[index], value)
        bound = [places.get(index, value) for index, value in enumerate(arguments)]
        session.kernel(source, name, size, *bound, group=group)()
        for index, place in places.items():
            session.download(place, arguments[index])
        session.finish()

    return run
