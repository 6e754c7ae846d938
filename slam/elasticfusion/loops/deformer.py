"""Samples the deformation graph from the map, and moves the map with it, on the device."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from slam.dense.images import intrinsics
from slam.devices.opencl import Session
from slam.elasticfusion.loops.graph import DEFORMING, Deformation, Graph
from slam.elasticfusion.mapping.surfels import Surfels

if TYPE_CHECKING:
    from slam.elasticfusion.images import RgbdImage

BEHIND = 0.1  # metres behind the old surface within which a surfel is taken for a part of it


class MapDeformer:
    """Samples the map's deformation graph and applies its deformation to the map."""

    def __init__(self, session: Session, surfels: Surfels) -> None:
        self._session = session
        self._surfels = surfels

    def sample(self, every: int) -> Graph:
        """One surfel of each `every` places, by first tick: the first that is left there."""
        surfels = self._surfels
        nodes = -(-surfels.count // every)
        if nodes == 0:
            return Graph(np.zeros((0, 3)), np.zeros(0, np.int64))
        places, times = np.empty((nodes, 4), np.float32), np.empty(nodes, np.int32)
        on_device = [self._session.buffer(array.nbytes, "the nodes") for array in (places, times)]
        self._session.kernel(
            DEFORMING,
            "sample_nodes",
            (nodes,),
            surfels.count,
            every,
            surfels.position_confidence,
            surfels.first_seen,
            *on_device,
        )()
        self._session.download(on_device[0], places)
        self._session.download(on_device[1], times)
        living = places[:, 3] > 0
        return Graph(places[living, :3].astype(np.float64), times[living].astype(np.int64))

    def deform(self, deformation: Deformation, tick: int) -> None:
        """Move every surfel, none of which is newer than `tick`."""
        graph = deformation.graph
        nodes = np.zeros((len(graph), 16), np.float32)
        nodes[:, :3] = graph.positions
        nodes[:, 3:12] = deformation.rotations.reshape(-1, 9)
        nodes[:, 12:15] = deformation.translations
        windows = np.stack(graph.windows(np.arange(tick + 1)), axis=1).astype(np.int32)
        surfels = self._surfels
        surfels.kernel(
            DEFORMING, "deform", self._uploaded(nodes), self._uploaded(windows), surfels.first_seen,
            surfels.position_confidence, surfels.normal_radius,
        )()  # fmt: skip

    def reactivate(
        self, surface: RgbdImage, pose: NDArray[np.float64], tick: int, confidence_threshold: float
    ) -> None:
        """Set `last_seen` = `tick` for stable surfels on or in front of `surface`, which is seen from `pose`.

        `surface` is the inactive map at the place where a loop was closed: it becomes active again.
        """
        camera, surfels = surface.camera, self._surfels
        view = np.linalg.inv(pose)[:3].astype(np.float32)
        surfels.kernel(
            DEFORMING, "reactivate", surfels.position_confidence, surfels.last_seen, surface.depth,
            camera.width, camera.height, intrinsics(camera), self._uploaded(view),
            float(confidence_threshold), BEHIND, tick,
        )()  # fmt: skip

    def _uploaded(self, values: NDArray[Any]) -> Any:
        buffer = self._session.buffer(values.nbytes, "the deformation graph")
        self._session.upload(buffer, values)
        return buffer
