"""Backends by the names people know, and a device's figures of several backends side by side."""

from collections.abc import Iterable
from dataclasses import dataclass

from crowd.devices.disclosure import find
from crowd.devices.models import ProcessorClass
from crowd.fronts.selectors import BEST
from crowd.results.reading import newest_times
from crowd.results.reading.newest_times import NewestTimes
from crowd.results.reading.rows import Speedup

# In the order in which they count where a model has several: a browser adds a cost to every frame that has
# nothing to do with the device.
BACKENDS = {
    "opencl": "OpenCL",
    "cuda": "CUDA",
    "metal": "Metal",
    "vulkan": "Vulkan",
    "cpu": "CPU",
    "webgpu": "WebGPU",
}
ORDER = tuple(BACKENDS)


@dataclass(frozen=True)
class BackendRow:
    """A backend on one device: its figure of `best`, and the times of its newest session that counts; None
    where the figure comes from suspect sessions alone.
    """

    figure: Speedup
    newest: NewestTimes | None


def preference(row: Speedup) -> tuple[bool, int]:
    """Smaller for what counts before other figures of a model: its GPU before its CPU, then by ORDER."""
    place = ORDER.index(row.backend) if row.backend in ORDER else len(ORDER)
    return row.processor_class != ProcessorClass.GPU, place


def leading(rows: Iterable[Speedup]) -> dict[str, Speedup]:
    """Of each model in ROWS one figure, by its slug: one that counts if there is any, by `preference`, then
    the fastest.
    """
    found: dict[str, Speedup] = {}
    for row in sorted(rows, key=lambda row: (not row.counts, preference(row), -row.speedup, row.processor)):
        found.setdefault(row.device.slug, row)
    return found


def side_by_side(slug: str, rows: Iterable[Speedup], front: str) -> tuple[BackendRow, ...]:
    """The backends with which `best` of FRONT was measured on the device SLUG, whose figures ROWS are.

    Of several processors of a backend the one that counts. Empty where there is one backend alone; else two
    queries a backend and two more.
    """
    own: dict[str, list[Speedup]] = {}
    for row in rows:
        if (row.front, row.configuration) == (front, BEST):
            own.setdefault(row.backend, []).append(row)
    model = find(slug) if len(own) > 1 else None
    if model is None:
        return ()
    figures = sorted((leading(each)[slug] for each in own.values()), key=preference)
    return tuple(BackendRow(figure, newest_times.of_device(figure, model.pk)) for figure in figures)
