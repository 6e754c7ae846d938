"""Sessions: on every device of every backend, and on one."""

import pytest

from slam.devices.choice import AnySession, choose_device, open_session
from tests.slam.backends import session

__all__ = ["session"]


@pytest.fixture(scope="module")
def cpu() -> AnySession:
    """One device, for what Python decides; what kernels compute is compared on every one."""
    return open_session(choose_device())
