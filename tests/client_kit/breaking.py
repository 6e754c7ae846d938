"""A worker whose driver breaks down, without OpenCL: `python -m tests.client_kit.breaking`.

Parameters say what becomes of a configuration: {"ends": "abort", "kill", "hang" or "close"}, {"fails": TEXT};
without any it runs. {"for_good": true} breaks the device, too, and {"takes_away": true} takes it away: the
file named by FRONTRUNNER_BROKEN stands for that, and no further process can open it, unless its text is
ONCE. {"unreadable": true} is measured over a sequence that cannot be read. Times are made up.
FRONTRUNNER_EMPTY_FRAME names what becomes of an empty frame: each one, or the first ("abort once").
With FRONTRUNNER_COMPILER the driver compiles in STEPS steps before it opens, of which the first never ends
where that is "hangs"; a configuration that hangs then never compiles.
"""

import os
import resource
import signal
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from client_kit.measuring import worker
from slam.benchmark import Progress
from slam.devices.device import NoDeviceError
from tests.client_kit.canned import STAGES

BROKEN = "FRONTRUNNER_BROKEN"
EMPTY_FRAME = "FRONTRUNNER_EMPTY_FRAME"
COMPILER = "FRONTRUNNER_COMPILER"
STEPS = 2
EMPTY_FRAME_SECONDS = 0.00025
FRAMES_BEFORE_THE_END = 3
GONE = "no OpenCL device here"
POSITION = [[2.4, 2.4, 0.5]]
ONCE = "once"
UNREADABLE = "frame 3 is damaged"


class BreakingWorker(worker.Worker):
    def __init__(self, *_: Any) -> None:
        broken = Path(os.environ[BROKEN])
        if broken.exists():
            if broken.read_text() == GONE:
                raise NoDeviceError(GONE)
            if broken.read_text() == ONCE:
                broken.unlink()
            end("abort")

    def empty_frame(self) -> worker.Answer:
        way, _, once = os.environ.get(EMPTY_FRAME, "").partition(" ")
        broke = Path(f"{os.environ[BROKEN]}-empty-frame")
        if way and not (once and broke.exists()):
            broke.touch()
            end(way)
        return {"empty_frame_seconds": EMPTY_FRAME_SECONDS}

    def measure(
        self,
        parameters: Mapping[str, Any],
        frames: int,
        first: int,
        progress: Progress,
    ) -> worker.Answer:
        assert 0 <= first <= frames
        if "fails" in parameters:
            return {"failure": parameters["fails"]}
        if "unreadable" in parameters:
            return {"cannot": UNREADABLE}
        for frame in range(frames):
            progress(frame + 1, frames)
            if "ends" in parameters and frame + 1 == FRAMES_BEFORE_THE_END:
                if parameters.get("for_good"):
                    Path(os.environ[BROKEN]).touch()
                if parameters.get("takes_away"):
                    Path(os.environ[BROKEN]).write_text(GONE)
                end(parameters["ends"])
        return {
            "report": report(frames, 0.04),
            "positions": POSITION * frames,
        }


class CompilingWorker(BreakingWorker):
    """Opens its device as the real one does."""

    def __init__(self, *setting: Any) -> None:
        super(BreakingWorker, self).__init__(*setting)

    def measure(self, parameters: Mapping[str, Any], *run: Any) -> worker.Answer:
        self._preparing("compiling for this device", 0, 1)
        if "ends" in parameters:
            signal.pause()
        return super().measure(parameters, *run)


def open_session(_application: str, _device: Any, progress: Progress) -> Any:
    for number in range(STEPS):
        progress(number, STEPS)
        if os.environ[COMPILER] == "hangs":
            signal.pause()
    progress(STEPS, STEPS)
    return object()


def report(frames: int, seconds: float) -> dict[str, Any]:
    """What a run tells that took `seconds` a frame."""
    times = {"computation": seconds, **dict.fromkeys(STAGES, seconds / 5)}
    ate = {"max": 0.012, "mean": 0.006, "rmse": 0.007}
    frame = {**times, "tracked": True}
    clocks = {"stage_clock": "device", "cpu_us": None, "waited_us": None}
    return {"frames": [frame] * frames, "ate": ate, **clocks}


def end(way: str) -> None:
    """What drivers and systems do to a process."""
    if way == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if way == "hang":
        signal.pause()
    if way == "close":  # and goes on
        os.closerange(3, 64)
        signal.pause()
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    print("LLVM ERROR: Cannot select /home/anna/cache/kernel.cl", file=sys.stderr, flush=True)
    os.abort()


if __name__ == "__main__":
    made_up: dict[str, Any] = {"Worker": BreakingWorker}
    if COMPILER in os.environ:
        made_up = {
            "Worker": CompilingWorker,
            "open_session": open_session,
            "open_sequence": lambda _: range(100),
            "choose_device": lambda *_: None,
        }
    for name, value in made_up.items():
        setattr(worker, name, value)
    worker.main()
