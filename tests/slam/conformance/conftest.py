"""Sessions on every device of every backend, and a way to run one kernel on NumPy arrays there."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from slam.devices.choice import AnySession
from slam.kfusion.pipeline import FOLDERS
from slam.plans.executors import prepare
from tests.slam.backends import session
from tests.slam.conformance.launching import launcher

__all__ = ["session"]


@pytest.fixture
def launch(session: AnySession) -> Callable[..., None]:
    """launch(kernel, grid, **arguments): see `launcher`."""
    return launcher(session.layout, lambda plan: prepare(plan, session, FOLDERS))
