"""Names and preference of backends, and a device's figures with several backends."""

from collections.abc import Iterable
from dataclasses import dataclass

from crowd.devices.disclosure import find
from crowd.devices.models import ProcessorClass
from crowd.records.speedup import Speedup
from crowd.results.reading import newest_times
from wire.front import BEST

# In order of preference: a browser adds a cost to each frame that is not the device's, and WebAssembly lacks
# instructions of the processor.
BACKENDS = {
    "opencl": "OpenCL",
    "cuda": "CUDA",
    "metal": "Metal",
    "vulkan": "Vulkan",
    "cpu": "CPU",
    "webgpu": "WebGPU",
    "wasm": "WebAssembly",
}
ORDER = tuple(BACKENDS)


@dataclass(frozen=True)
class BackendRow:
    """A backend on one device: its figure of `best`, and its times (seconds per frame), if any."""

    figure: Speedup
    default: float | None
    best: float | None


def preference(row: Speedup) -> tuple[bool, int]:
    """Sort key of a model's figures, preferred ones first: GPU before CPU, then by ORDER."""
    rank = ORDER.index(row.backend) if row.backend in ORDER else len(ORDER)
    return row.processor_class != ProcessorClass.GPU, rank


def leading_figures(rows: Iterable[Speedup]) -> dict[str, Speedup]:
    """One figure of each model in `rows`, by slug: what counts first, then by `preference`, then by speed."""
    leading: dict[str, Speedup] = {}
    for row in sorted(rows, key=lambda row: (not row.counts, preference(row), -row.speedup, row.processor)):
        leading.setdefault(row.device.slug, row)
    return leading


def backend_comparison(slug: str, rows: Iterable[Speedup], front: str) -> tuple[BackendRow, ...]:
    """The backends with a figure of `best` of `front` on the device `slug`. `rows` are its figures.

    Times are those of the newest valid session. With several processors, the preferred one. Empty for a
    single backend; else two queries for each backend and two more.
    """
    by_backend: dict[str, list[Speedup]] = {}
    for row in rows:
        if (row.front, row.configuration) == (front, BEST):
            by_backend.setdefault(row.backend, []).append(row)
    model = find(slug) if len(by_backend) > 1 else None
    if model is None:
        return ()
    figures = sorted((leading_figures(each)[slug] for each in by_backend.values()), key=preference)
    newest = [newest_times.times_of_device(figure, model.pk) for figure in figures]
    return tuple(
        BackendRow(figure, times.default if times else None, times.best if times else None)
        for figure, times in zip(figures, newest, strict=True)
    )
