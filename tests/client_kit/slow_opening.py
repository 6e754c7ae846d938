"""A worker on a slow phone that was never seen before: `python -m tests.client_kit.slow_opening`.

Opening the device tries LAYOUTS layouts of kernels, for SECONDS_EACH. Nothing else is real either.
"""

import time
from collections.abc import Mapping
from typing import Any

from client_kit.measuring import worker
from slam.devices.tuning import Progress
from tests.client_kit.breaking import EMPTY_FRAME_SECONDS, BreakingWorker

LAYOUTS = 5
SECONDS_EACH = 0.6
LIMIT_SECONDS = 2


def open_session(_application: str, _device: Any, progress: Progress | None = None) -> Any:
    for number in range(LAYOUTS):
        time.sleep(SECONDS_EACH)
        if progress is not None:
            progress(number + 1, LAYOUTS)
    return object()


class SlowWorker(worker.Worker):
    """The real one, except its measurements."""

    def empty_frame(self) -> worker.Answer:
        return {"empty_frame_seconds": EMPTY_FRAME_SECONDS}

    def measure(self, parameters: Mapping[str, Any], frames: int, first: int, progress: Any) -> Any:
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
