"""The parts of `tests.benchmarks.device_map` that need a database: a simulated crowd, and a large one.

Each step is a process of its own on a data folder: python -m tests.benchmarks.device_map_crowd STEP.
"""

import json
import resource
import subprocess
import sys
import time
from pathlib import Path

import django

from tests.benchmarks import device_map_filling
from tests.services.program import ROOT
from tests.services.serving import command, environment
from tests.shipped import KFUSION

SEED = 0


def prepare(var: Path) -> None:
    """Make `var` a data folder with the tables and the front.

    AssertionError with the reason where it fails.
    """
    _run(var, "migrate", "--verbosity=0")
    _run(var, "front", "publish", "--yes", str(KFUSION))


def simulate(var: Path) -> None:
    """Make `var` the folder of a demo server."""
    _run(var, "prepare", "--demo", f"--seed={SEED}")


def _run(var: Path, *arguments: str) -> None:
    done = command(var, *arguments)
    assert done.returncode == 0, done.stderr


def inside(var: Path, step: str) -> str:
    """What `step` prints in a process of its own on the data folder `var`."""
    done = subprocess.run(
        [sys.executable, "-m", __name__, step],
        cwd=ROOT,
        env=environment(var, DJANGO_SETTINGS_MODULE="crowd.settings"),
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return done.stdout.strip()


def compare() -> str:
    """Devices that measured every point of the front, each predicted from other series of chips."""
    from crowd.fronts import selectors as fronts
    from crowd.predictions import tables
    from tests.benchmarks import device_map_comparison as comparison
    from wire.protocol import VALID_BELOW

    front = fronts.front(KFUSION.stem)
    assert front is not None
    group = next(group for group in tables.groups() if group.processor_class == "gpu")
    known = tables.read_table(front, group).known
    points, others = (
        [point.name for point in several if point.ate_max is not None and point.ate_max <= VALID_BELOW]
        for several in (front.points, front.probes)
    )
    made = list(comparison.predictions(known, len(front.points) - 2))
    devices = {one.target.name for one in made}
    return (
        f"Simulated: {len(known.ratios)} devices with a graphics chip, of {known.families.nunique()} series; "
        f"{len(devices)} that measured every point are predicted.\n\n"
        f"{comparison.report(made, points, others)}"
    )


def fill() -> str:
    """A large crowd with a figure of every configuration and a session for each device."""
    begun = time.perf_counter()
    filled = device_map_filling.fill(KFUSION.stem)
    return f"Filled in {time.perf_counter() - begun:.0f} s: {filled}."


def rebuild() -> str:
    """Seconds, CPU and the most memory of the nightly rebuild, and how much of it was there before."""
    from crowd.predictions import maps

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    begun, cpu = time.perf_counter(), time.process_time()
    made = maps.rebuild()
    seconds, cpu = time.perf_counter() - begun, time.process_time() - cpu
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return (
        f"| devices | rung | seconds | CPU seconds | MB before | MB at most |\n|--:|---|--:|--:|--:|--:|\n"
        f"| {made[0].devices} | {made[0].rung} | {seconds:.1f} | {cpu:.1f} | {before:.0f} | {most:.0f} |\n\n"
        f"Errors by rung: {json.dumps(made[0].errors)}"
    )


STEPS = {"compare": compare, "fill": fill, "rebuild": rebuild}

if __name__ == "__main__":
    django.setup()
    sys.stdout.write(f"{STEPS[sys.argv[1]]()}\n")
