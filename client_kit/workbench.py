"""The process that holds the OpenCL device during a session: `python -m client_kit.workbench`; see `bench`.

It answers orders, lines of JSON on its input, with lines of JSON on its output. The first order names the
place, {"application", "sequence", "device"}, and is answered by {"ready": true}. Each further one,
{"parameters", "frames"}, is a measurement: after every frame it tells {"done", "total"} and waits for an
empty line, so that whatever the other side does between frames costs no measured time. At the end it tells
{"report", "trajectory_sha256"}, or {"failure"} where the configuration failed in an orderly way, or
{"cannot"} where no configuration can be measured at all. It ends with its input: nobody is left to measure
for.
"""

import hashlib
import json
import os
import signal
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from client_kit import interrupts, reasons
from slam import benchmark
from slam.datasets import SequenceError, open_sequence
from slam.devices.choice import choose_device
from slam.devices.device import NoDeviceError
from slam.devices.opencl import Session
from slam.systems import open_session

Answer = dict[str, Any]


class Workbench:
    """The device, opened once for all measurements of a session, and again after an error."""

    def __init__(self, application: str, sequence: Path, device: str) -> None:
        """Raises SequenceError, NoDeviceError, and whatever a driver that does not work raises."""
        self._application = application
        self._sequence = open_sequence(sequence)
        self._device = choose_device(device)
        self._opened: Session | None = open_session(application, self._device)

    def measure(self, parameters: Mapping[str, Any], frames: int, progress: benchmark.Progress) -> Answer:
        """One configuration over the first FRAMES frames of the sequence."""
        try:
            if self._opened is None:
                self._opened = open_session(self._application, self._device)
            report = benchmark.run(
                parameters,
                self._sequence,
                system=self._application,
                frames=frames,
                device=self._opened,
                progress=progress,
            )
        except SequenceError as error:
            return {"cannot": str(error)}
        except Exception as error:  # whatever a driver raises says something of this configuration here
            self._opened = None  # an error may leave the driver's context unusable
            return {"failure": reasons.of(error)}
        poses = np.ascontiguousarray(report.poses, "<f8")
        return {
            "report": report.to_dict(),
            "trajectory_sha256": hashlib.sha256(poses.tobytes()).hexdigest(),
        }


def serve(orders: TextIO, answers: TextIO) -> None:
    """Answer ORDERS until they end."""

    def tell(answer: Answer) -> None:
        print(json.dumps(answer), file=answers, flush=True)

    def between_frames(done: int, total: int) -> None:
        tell({"done": done, "total": total})
        if not orders.readline():
            sys.exit("nobody is left to measure for")

    place = json.loads(orders.readline())
    try:
        workbench = Workbench(place["application"], Path(place["sequence"]), place["device"])
    except (SequenceError, NoDeviceError) as error:
        tell({"cannot": str(error)})
        return
    tell({"ready": True})
    for line in orders:
        order = json.loads(line)
        tell(workbench.measure(order["parameters"], order["frames"], between_frames))


def main() -> None:
    """Serve standard input and output. Who started this process decides when it ends, not a signal to all."""
    for number in interrupts.ENDING:
        signal.signal(number, signal.SIG_IGN)
    with os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8") as answers:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # drivers write to standard output, too
        serve(sys.stdin, answers)


if __name__ == "__main__":
    main()
