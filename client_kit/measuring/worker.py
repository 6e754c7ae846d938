"""The worker process, which holds the device during a session; see `worker_client`.

It reads orders as lines of JSON from standard input and answers with lines of JSON.

- The first order is {"application", "sequence", "device", "backend"}. The answer is {"ready": true}.
- {"empty_frame": true} asks for {"empty_frame_seconds"}.
- {"parameters", "frames", "first"} is a measurement. After every frame the worker sends {"done", "total"} and
  waits for an empty line, so that the client's work between frames is not measured. At the end it sends
  {"report", "positions"}. Processor time in the report is of the frames from "first" on.

{"failure"} reports that the order failed, {"cannot"} that nothing can be measured at all. While the driver
compiles, {"preparing", "done", "total"} names the steps. The worker ends at the end of its input.
"""

import json
import os
import signal
import sys
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TextIO

from client_kit import interrupts
from client_kit.measuring import reasons
from slam import benchmark
from slam.datasets import SequenceError, open_sequence
from slam.datasets.sequence import Progress
from slam.devices.choice import AnySession, choose_device
from slam.devices.device import NoDeviceError
from slam.registry import open_session
from wire.protocol import DECODED_AHEAD

Answer = dict[str, Any]
# Called with what is done, and the numbers of steps done and in total.
Preparing = Callable[[str, int, int], None]


class Worker:
    """The device, opened once for all measurements of a session, and again after an error."""

    def __init__(
        self, application: str, sequence: Path, device: str, backend: str, preparing: Preparing
    ) -> None:
        """Raises SequenceError, NoDeviceError, and any error of a broken driver."""
        self._application, self._preparing = application, preparing
        self._sequence = open_sequence(sequence)
        self._device = choose_device(device, backend)
        self._opened: AnySession | None = self._open()

    def empty_frame(self) -> Answer:
        """The cost of an empty frame."""
        return self._attempt(lambda opened: {"empty_frame_seconds": benchmark.empty_frame_seconds(opened)})

    def measure(self, parameters: Mapping[str, Any], frames: int, first: int, progress: Progress) -> Answer:
        """One configuration over the first `frames` frames of the sequence; those from `first` on count."""

        def measured(opened: AnySession) -> Answer:
            report = benchmark.run(
                parameters,
                self._sequence,
                system=self._application,
                frames=frames,
                device=opened,
                progress=progress,
                decoded_ahead=DECODED_AHEAD,
                compiling=partial(self._preparing, "compiling for this device"),
                first_counted=first,
            )
            return {"report": report.to_dict(), "positions": report.poses[:, :3, 3].tolist()}

        return self._attempt(measured)

    def _attempt(self, work: Callable[[AnySession], Answer]) -> Answer:
        try:
            self._opened = self._opened or self._open()
            return work(self._opened)
        except SequenceError as error:
            return {"cannot": str(error)}
        except Exception as error:  # any error of a driver is the result of this order
            self._opened = None  # an error may leave the driver's context unusable
            return {"failure": reasons.describe(error)}

    def _open(self) -> AnySession:
        trying = partial(self._preparing, "trying kernel layouts")
        return open_session(self._application, self._device, trying)


def serve(orders: TextIO, answers: TextIO) -> None:
    """Answer all `orders`."""

    def send(answer: Answer) -> None:
        print(json.dumps(answer), file=answers, flush=True)

    def preparing(what: str, done: int, total: int) -> None:
        send({"preparing": what, "done": done, "total": total})

    def between_frames(done: int, total: int) -> None:
        send({"done": done, "total": total})
        if not orders.readline():
            sys.exit("the client that asked for this measurement has ended")

    setting = json.loads(orders.readline())
    try:
        worker = Worker(
            setting["application"],
            Path(setting["sequence"]),
            setting["device"],
            setting["backend"],
            preparing,
        )
    except (SequenceError, NoDeviceError) as error:
        send({"cannot": str(error)})
        return
    send({"ready": True})
    for line in orders:
        order = json.loads(line)
        if "empty_frame" in order:
            send(worker.empty_frame())
        else:
            send(worker.measure(order["parameters"], order["frames"], order["first"], between_frames))


def main() -> None:
    """Serve standard input and output.

    The parent decides when this process ends, not a signal to the group.
    """
    for number in interrupts.ENDING:
        signal.signal(number, signal.SIG_IGN)
    with os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8") as answers:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # drivers write to standard output, too
        serve(sys.stdin, answers)


if __name__ == "__main__":
    main()
