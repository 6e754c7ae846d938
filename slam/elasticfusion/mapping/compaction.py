"""Closing the gaps in the map, without changing its order and with little memory beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from slam.devices.opencl import Session
from slam.elasticfusion.mapping.surfels import RUN, Surfels

SOURCE = Path(__file__).parents[1] / "kernels" / "compaction.cl"
STRETCH = 64  # runs gathered at once: 65,536 surfels, 2.75 MiB


class Compaction:
    """Moves the living surfels together, stretch by stretch.

    A stretch is gathered outside the map and copied to its new place, which is never after the stretch
    itself. So nothing is overwritten before it is moved.
    """

    def __init__(self, session: Session, surfels: Surfels) -> None:
        self._session = session
        self._surfels = surfels
        self._arrays = [
            (array, session.buffer(size * STRETCH * RUN, "a stretch of the map"), size)
            for array, size in (
                (surfels.position_confidence, 16),
                (surfels.normal_radius, 16),
                (surfels.colour, 4),
                (surfels.first_seen, 4),
                (surfels.last_seen, 4),
            )
        ]
        self._runs = session.buffer(4 * -(-surfels.capacity // RUN), "the map's runs")
        self._count_living = session.kernel(
            SOURCE, "count_living", (1,), 0, surfels.position_confidence, self._runs
        )
        self._gather = session.kernel(
            SOURCE, "gather_living", (1,), 0, 0, self._runs, *(array for array, _, _ in self._arrays),
            *(gathered for _, gathered, _ in self._arrays),
        )  # fmt: skip

    def compact(self) -> int:
        """Free the places of removed surfels and return their number. The order stays."""
        surfels, runs, session = self._surfels, self._surfels.runs, self._session
        if runs == 0:
            return 0
        self._count_living.set(0, surfels.count)
        self._count_living((runs,))
        living = np.empty(runs, np.int32)
        session.download(self._runs, living)
        before = np.concatenate([[0], np.cumsum(living)]).astype(np.int32)
        session.upload(self._runs, before[:-1])
        self._gather.set(0, surfels.count)
        for first in range(0, runs, STRETCH):
            last = min(first + STRETCH, runs)
            length = int(before[last] - before[first])
            if length == 0 or before[last] == min(last * RUN, surfels.count):
                continue  # nothing lives here, or no gap so far
            self._gather.set(1, first)
            self._gather((last - first,))
            for array, gathered, size in self._arrays:
                session.copy(array, gathered, size * length, offset=size * int(before[first]))
        empty = surfels.count - int(before[-1])
        surfels.count -= empty
        return empty
