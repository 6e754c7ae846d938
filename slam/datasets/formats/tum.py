"""Folders in the layout of the TUM RGB-D benchmark, and those of Open3D, which are like them.

`depth/` and optionally `rgb/` (Open3D: `color/` or `image/`) hold images; `depth.txt`, `rgb.txt` or
`associations.txt` give their stamps, otherwise the file names are stamps or frame numbers at 30 Hz; stamps in
lists that are written without a point are frame numbers too, as in ICL-NUIM's `associations.txt`, unless they
are nanoseconds since 1970; `groundtruth.txt` holds TUM poses.
"""

from __future__ import annotations

from pathlib import Path

from slam.camera import Camera
from slam.datasets.formats import images
from slam.datasets.formats.image_folder import ImageFolder
from slam.datasets.formats.listing import listed
from slam.datasets.sequence import Given, Progress, Sequence, SequenceError, read_truth
from slam.trajectories.readings import mirror_y
from slam.trajectories.trajectory import Trajectory, associate

STANDARD_UNITS = 5000.0  # a metre, in the TUM benchmark's own folders, which carry no intrinsics.txt
COLOUR_FOLDERS = ("rgb", "color", "image")  # the second and third are Open3D's


class TumSequence(ImageFolder):
    """Depth and colour images in folders of their own; colour images are matched to depth by stamp."""

    def __init__(
        self,
        folder: Path,
        camera: Given = None,
        truth: Path | None = None,
        units: float | None = None,
        usual_camera: Camera | None = None,
    ) -> None:
        depth, self.timestamps, numbers = listed(folder, "depth")
        if not depth:
            raise SequenceError(f"{folder}/depth holds no image: a TUM-layout folder has depth/*.png")
        super().__init__(folder, depth, camera, units, usual_camera, STANDARD_UNITS)
        self._check_focal_length(given=camera is not None)
        self._colour = self._matched_colour()
        truth = truth or (folder / "groundtruth.txt" if (folder / "groundtruth.txt").exists() else None)
        if truth is not None:
            self.truth = read_truth(truth, self.camera, self.timestamps, numbers)

    def _check_focal_length(self, given: bool) -> None:
        """Refuse an fy below 0 in intrinsics.txt: only ICL-NUIM mirrors y."""
        if self.camera.fy < 0 and not given:
            raise SequenceError(
                f"{self._folder / 'intrinsics.txt'}: the focal length fy={self.camera.fy:g} must be above 0: "
                "write pixels; where y is mirrored, as in ICL-NUIM, give --camera and --truth"
            )

    def _matched_colour(self) -> dict[int, Path]:
        kind = next((kind for kind in COLOUR_FOLDERS if (self._folder / kind).is_dir()), COLOUR_FOLDERS[0])
        paths, stamps, _ = listed(self._folder, kind)
        frames, rows = associate(self.timestamps, stamps, 0.02)
        return {int(frame): paths[row] for frame, row in zip(frames, rows, strict=True)}


def write(sequence: Sequence, folder: Path, progress: Progress | None = None) -> None:
    """Write any sequence as a TUM-layout folder, depth in units of a millimetre.

    Where y is mirrored (fy below 0), camera and truth are mirrored back, as such a folder has OpenCV's axes.
    Files of the same names are overwritten.
    """
    frames = len(sequence)
    for kind in ("depth", "rgb"):
        (folder / kind).mkdir(parents=True, exist_ok=True)
    listing: dict[str, list[str]] = {"depth": [], "rgb": []}
    for index in range(frames):
        images.write_depth(folder / "depth" / f"{index:06d}.png", sequence.depth(index))
        listing["depth"].append(f"{sequence.timestamps[index]:.6f} depth/{index:06d}.png")
        colour = sequence.colour(index)
        if colour is not None:
            images.write_colour(folder / "rgb" / f"{index:06d}.png", colour)
            listing["rgb"].append(f"{sequence.timestamps[index]:.6f} rgb/{index:06d}.png")
        if progress:
            progress(index + 1, frames)
    for kind, lines in listing.items():
        if lines:
            (folder / f"{kind}.txt").write_text("".join(line + "\n" for line in lines), encoding="utf-8")
        else:
            (folder / kind).rmdir()
    c = sequence.camera
    (folder / "intrinsics.txt").write_text(
        f"{c.fx!r} {abs(c.fy)!r} {c.cx!r} {c.cy!r} {c.width} {c.height} 1000\n", encoding="utf-8"
    )
    if sequence.truth is not None:
        truth = mirror_y(sequence.truth) if c.fy < 0 else sequence.truth
        Trajectory(sequence.timestamps, truth).write(folder / "groundtruth.txt")
