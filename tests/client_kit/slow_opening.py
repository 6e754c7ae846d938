"""A worker whose driver compiles slowly: `python -m tests.client_kit.slow_opening`.

Opening the device takes STEPS steps of SECONDS_EACH, and never ends with FRONTRUNNER_NEVER=opening. A
configuration that "ends" never compiles. Nothing else is real either.
"""

import os
import signal
import time
from collections.abc import Mapping
from typing import Any

from client_kit.measuring import worker
from slam.devices.tuning import Progress
from tests.client_kit.breaking import EMPTY_FRAME_SECONDS, BreakingWorker

NEVER = "FRONTRUNNER_NEVER"
STEPS = 2
SECONDS_EACH = 1.5
SHORTER_SECONDS = 1


def open_session(_application: str, _device: Any, progress: Progress) -> Any:
    for number in range(STEPS):
        progress(number, STEPS)
        if os.environ.get(NEVER) == "opening":
            signal.pause()
        time.sleep(SECONDS_EACH)
    progress(STEPS, STEPS)
    return object()


class SlowWorker(worker.Worker):
    """The real one, except its measurements."""

    def empty_frame(self) -> worker.Answer:
        return {"empty_frame_seconds": EMPTY_FRAME_SECONDS}

    def measure(self, parameters: Mapping[str, Any], frames: int, first: int, progress: Any) -> Any:
        self._preparing("compiling for this device", 0, 1)
        if "ends" in parameters:
            signal.pause()
        time.sleep(SECONDS_EACH)
        return BreakingWorker.measure(self, parameters, frames, first, progress)  # type: ignore[arg-type]


if __name__ == "__main__":
    made_up: dict[str, Any] = {
        "open_session": open_session,
        "open_sequence": lambda _: range(100),
        "choose_device": lambda *_: None,
        "Worker": SlowWorker,
    }
    for name, value in made_up.items():
        setattr(worker, name, value)
    worker.main()
