"""CPU milliseconds a frame by kernel, the largest first, as JSON: for `speed`.

    python kernel_times.py SYSTEM SEQUENCE FRAMES SETTINGS

It waits for each kernel, which costs some microseconds a launch, and counts the CPU time of all threads.
"""

import json
import sys
import time
from collections import defaultdict

from slam import benchmark
from slam.datasets import open_sequence
from slam.devices.opencl import Session


def main() -> None:
    system, path, count, text = sys.argv[1:]
    spent: defaultdict[str, float] = defaultdict(float)
    launch, warm_up = Session.launch, benchmark._warm_up

    def timed(self, kernel, name, size, group):
        self.finish()
        began = time.process_time()
        event = launch(self, kernel, name, size, group)
        event.wait()
        spent[name] += time.process_time() - began
        return event

    def forgotten(*arguments):
        warm_up(*arguments)
        spent.clear()

    Session.launch, benchmark._warm_up = timed, forgotten
    benchmark.run(json.loads(text), open_sequence(path), system=system, frames=int(count))
    largest = sorted(spent.items(), key=lambda item: -item[1])
    sys.stdout.write(json.dumps({"kernels": {name: 1e3 * total / int(count) for name, total in largest}}))


if __name__ == "__main__":
    main()
