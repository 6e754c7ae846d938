"""python -m tests.benchmarks.device_map: how well a device's times are predicted from those of others.

Parts, all where none is named: `fixture` (docs/research/device-map.csv), `simulated` (a demo server with 83
devices in a temporary database), `rebuild` (seconds and memory of the nightly rebuild with 2,000 devices).
Prints Markdown tables: the median relative error of ratios, its mean over devices and that of the worst
device; how many ratios lay within their 95 % intervals, as believed and as widened by what other families
showed; by how much the recommended point is slower than the fastest one (`regret`), and the one that is
predicted to be `fastest`, whatever its interval; the same where probes may be recommended, too (`any`). Rung
`devices` is fitted below its least number of families, too.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pareto.devices.device_map import DEFAULT, SEPARATOR, DeviceMap, log_ratios, stage_quantity
from slam.datasets.formats.pack import Pack
from slam.devices.layout import Layout
from slam.kfusion.configuration import Configuration
from slam.kfusion.plan import plan
from slam.kfusion.work import work
from slam.system import STAGES, scene_of
from tests.benchmarks import device_map_comparison as comparison
from tests.benchmarks import device_map_crowd as crowd
from tests.benchmarks.sequences import ROOT, SEQUENCE
from tests.shipped import KFUSION
from wire.protocol import FIRST_COUNTED_FRAME, VALID_BELOW

MEASURED = ROOT / "docs" / "research" / "device-map.csv"  # of all configurations, on devices of one machine
FRAMES = {"opencl": 40, "webgpu": 20}  # of each measurement
REFERENCE = "pocl rows 2"
ERROR, STAGE_ERROR = 0.03, 0.05  # standard errors of logarithms of one process each
LEAST = 5  # configurations besides default and best, of a device that is predicted


def fixture(say: Callable[[str], Any]) -> None:
    """OpenCL and WebGPU devices, each predicted from the other drivers of its kind."""
    measured = pd.read_csv(MEASURED)
    front = json.loads(KFUSION.read_text())
    points, others = (_exact(front[kind]) for kind in ("configurations", "probes"))
    opencl, webgpu = (device_map(measured, front, backend) for backend in ("opencl", "webgpu"))
    for title, devices in (
        ("OpenCL", opencl),
        ("OpenCL, the front's own times as the reference", published(opencl, front)),
        ("WebGPU", webgpu),
    ):
        say(f"\n### {title}: {len(devices.ratios)} devices of {devices.families.nunique()} drivers\n")
        say(comparison.report(list(comparison.predictions(devices, LEAST)), points, others))


def device_map(measured: pd.DataFrame, front: Mapping[str, Any], backend: str) -> DeviceMap:
    """The devices of `backend` without the reference device, which is one with OpenCL."""
    reference = measured[measured.device == REFERENCE].set_index("configuration")
    of_backend = measured[(measured.backend == backend) & (measured.device != REFERENCE)]
    names = list(dict.fromkeys(of_backend.configuration))
    ratios = _ratios(of_backend, names)
    errors = ratios.copy()
    errors[:] = np.where([SEPARATOR in name for name in ratios.columns], STAGE_ERROR, ERROR)
    families = of_backend.groupby("device").family.first().reindex(ratios.index)
    reference_ratios = _ratios(reference.reset_index(), names).iloc[0]
    stage_times = reference.loc[names, list(STAGES)] / reference.seconds[DEFAULT]
    return DeviceMap(
        ratios, errors, families, reference_ratios, _work(front, names, FRAMES[backend]), stage_times
    )


def published(devices: DeviceMap, front: Mapping[str, Any]) -> DeviceMap:
    """`devices` with what `front` says of the reference device, as servers take it."""
    points = (*front["configurations"], *front["probes"])
    times = {point["name"]: point["predicted"]["on_sequence"] for point in points}
    seconds = {
        name: times[configuration]["stages"][stage] if stage else times[configuration]["runtime_ratio"]
        for name in devices.reference.index
        for configuration, _, stage in [name.partition(SEPARATOR)]
    }
    assert devices.stage_times is not None
    stages = pd.DataFrame({name: times[name]["stages"] for name in devices.stage_times.index}).T
    return replace(devices, reference=-np.log(pd.Series(seconds)), stage_times=stages[list(STAGES)])


def _ratios(measured: pd.DataFrame, names: list[str]) -> pd.DataFrame:
    """Logarithms by device of configurations `names` and of the stages of the default and best."""
    seconds = measured.pivot(index="device", columns="configuration", values="seconds")[names]
    for name in (DEFAULT, comparison.BEST):
        rows = measured[measured.configuration == name].set_index("device")
        for stage in STAGES:
            seconds[stage_quantity(name, stage)] = rows[stage]
    return log_ratios(seconds)


def _work(front: Mapping[str, Any], names: list[str], frames: int) -> pd.DataFrame:
    """What configurations compute, as in `crowd.predictions.tables.workloads`, over the frames measured."""
    scene = scene_of(Pack(SEQUENCE))
    loads = {}
    for point in (*front["configurations"], *front["probes"]):
        if point["name"] in names:
            made = plan(Configuration.from_mapping(point["parameters"]), scene, Layout("pixels"))
            loads[point["name"]] = work(made, range(FIRST_COUNTED_FRAME, frames))
    columns = sorted({key for load in loads.values() for key in load})
    units = [[load.get(key, 0.0) for key in columns] for load in loads.values()]
    return pd.DataFrame(units, index=list(loads), columns=pd.MultiIndex.from_tuples(columns))


def _exact(points: list[Mapping[str, Any]]) -> list[str]:
    return [point["name"] for point in points if point["predicted"]["ate_max"] <= VALID_BELOW]


def simulated(say: Callable[[str], Any]) -> None:
    """A demo server; devices that measured enough are predicted from other series of chips."""
    with tempfile.TemporaryDirectory() as folder:
        crowd.simulate(Path(folder))
        say("\n### Simulated crowd: these devices were not measured\n")
        say(crowd.inside(Path(folder), "compare"))


def rebuild(say: Callable[[str], Any]) -> None:
    """The nightly rebuild of a large crowd, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        crowd.prepare(Path(folder))
        say("\n### Rebuild\n")
        say(crowd.inside(Path(folder), "fill"))
        say(crowd.inside(Path(folder), "rebuild"))


PARTS = {"fixture": fixture, "simulated": simulated, "rebuild": rebuild}


def main() -> None:
    def say(text: str) -> None:
        print(text, flush=True)

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", nargs="?", choices=PARTS, help="all where it is absent")
    part = parser.parse_args().part
    for name in PARTS if part is None else [part]:
        PARTS[name](say)


if __name__ == "__main__":
    main()
