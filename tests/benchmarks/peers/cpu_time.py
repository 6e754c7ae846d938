"""One run, for `speed`: CPU milliseconds a frame, errors, and the time of a frame's launches alone, as JSON.

    python cpu_time.py SYSTEM SEQUENCE FRAMES SETTINGS

It imports the `slam` that Python finds: that of this commit or of another.
"""

import json
import sys
import time
from dataclasses import replace

import numpy as np

from slam import benchmark
from slam.datasets import open_sequence
from slam.devices.choice import choose_device
from slam.kfusion.configuration import Configuration
from slam.kfusion.pipeline import FOLDERS
from slam.kfusion.plan import plan
from slam.plans.executors import prepare
from slam.registry import open_session
from slam.system import scene_of


def launches_ms(sequence, settings, frames: int) -> float:
    """CPU milliseconds of a frame whose every launch has one work-group; it computes nothing of use."""
    session = open_session("kfusion", choose_device())
    whole = plan(Configuration.from_mapping(settings), scene_of(sequence, None, None), session.layout)
    small = replace(whole, dispatches=tuple(replace(each, size=each.group) for each in whole.dispatches))
    execution, image = prepare(small, session, FOLDERS), np.zeros_like(sequence.depth(0))
    for number in range(10):
        execution.run(number, image)
    began = time.process_time()
    for number in range(10, 10 + frames):
        execution.run(number, image)
    return 1e3 * (time.process_time() - began) / frames


def main() -> None:
    system, path, count, text = sys.argv[1:]
    sequence, frames, settings = open_sequence(path), int(count), json.loads(text)
    report = benchmark.run(settings, sequence, system=system, frames=frames)
    ate = None if report.ate is None else {"mean": report.ate.mean, "max": report.ate.max}
    floor = launches_ms(sequence, settings, frames) if system == "kfusion" else 0.0
    result = {"cpu_ms": 1e3 * report.cpu_seconds / frames, "ate": ate, "launches_ms": floor}
    sys.stdout.write(json.dumps(result))


if __name__ == "__main__":
    main()
