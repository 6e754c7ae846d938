"""A prediction with its holes filled from the live image: tracking uses it while the map has gaps."""

from __future__ import annotations

from pathlib import Path

from slam.devices.opencl import Session
from slam.elasticfusion.images import RgbdImage

SOURCE = Path(__file__).parents[1] / "kernels" / "fill_in.cl"


class FillIn:
    """`image`: the predicted image where there is one, elsewhere the live one of the same camera and pose."""

    def __init__(self, session: Session, predicted: RgbdImage, live: RgbdImage) -> None:
        camera = predicted.camera
        self.image = RgbdImage.allocate(session, camera)
        maps = [
            buffer
            for image in (predicted, live, self.image)
            for buffer in (image.depth, *image.normals, image.colour)
        ]
        self._fill = session.image_kernel(
            SOURCE, "fill_in", camera.width, camera.height, *maps, camera.width, camera.height, 1, 1, 1
        )
        self._keep = len(maps) + 2  # index of the first of three arguments: what is kept and filled

    def fill(self, keep_depth: bool = True, keep_colour: bool = True, holes: bool = True) -> None:
        """Enqueue it. Without `keep_depth` depth and normals are wholly the live image's, and without
        `keep_colour` colour is. Without `holes` what is kept stays empty where nothing is predicted.
        """
        for index, choice in enumerate((keep_depth, keep_colour, holes), start=self._keep):
            self._fill.set(index, int(choice))
        self._fill()
