"""The interface of every sequence, whatever its format."""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from slam.camera import Camera
from slam.trajectories.readings import Axes, mirror_y
from slam.trajectories.trajectory import Trajectory, associate, check_poses

FRAME_RATE = 30.0  # frames a second, where a format has no stamps: the rate of the Kinect and of ICL-NUIM
SMALLEST_JUDGED = 32  # pixels
LARGEST_SIDE = 16384  # pixels
LARGEST_VOLUME = 1e4  # metres
# What a caller may give of a camera: fx, fy, cx, cy where the files tell their size, or everything.
Given = Camera | tuple[float, float, float, float] | None
UPWARD_SUFFIX = ".freiburg"  # of ICL-NUIM's files of poses

Progress = Callable[[int, int], None]  # called with the number of frames done and the number of all frames


class SequenceError(ValueError):
    """A sequence that cannot be read; the message names the file and what would be right."""


def file_sha256(path: Path) -> str:
    """The SHA-256 of a file, hexadecimal. Raises SequenceError when it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise SequenceError(f"{path} cannot be read: {error.strerror}") from None


class DigestError(SequenceError):
    """Content that is not what its digest promises."""


class Sequence(ABC):
    """An RGB-D sequence.

    `timestamps` are float64 (n,), seconds. `truth` is None or float64 (n, 4, 4), camera to world, OpenCV
    axes, metres, with NaN for frames of which the true pose is not known. `volume_size` (m) and
    `initial_position` (fraction of the volume) say where the reconstruction cube of this scene lies,
    where someone has chosen it. `fixed_size`: images are never cropped, as clients' plans have the size of
    a pack. `cropped_from`: (width, height) before images were cropped, None where they were not.
    `assumed_units`: the depth units per metre where neither files nor caller say them. `truth_axes`: those
    that the file of true poses was read in.
    """

    name: str
    camera: Camera
    timestamps: npt.NDArray[np.float64]
    truth: npt.NDArray[np.float64] | None = None
    volume_size: float | None = None
    initial_position: tuple[float, float, float] | None = None
    fixed_size: bool = False
    cropped_from: tuple[int, int] | None = None
    assumed_units: float | None = None
    truth_axes: Axes = "opencv"

    def __len__(self) -> int:
        return len(self.timestamps)

    @abstractmethod
    def depth(self, index: int) -> npt.NDArray[np.uint16]:
        """Depth of a frame, (height, width), millimetres along the optical axis, 0 where not measured.

        Raises IndexError outside 0..n-1 and SequenceError when the frame is damaged.
        """

    def colour(self, index: int) -> npt.NDArray[np.uint8] | None:
        """Colour of a frame, (height, width, 3) in the order red, green, blue, or None without colour."""
        self.check_index(index)
        return None

    @property
    @abstractmethod
    def sha256(self) -> str:
        """A digest of the content: equal for equal files, whatever they are called."""

    def check_index(self, index: int) -> None:
        if not 0 <= index < len(self):
            raise IndexError(f"frame {index} of {self.name!r}: it has the frames 0 to {len(self) - 1}")


class DerivedSequence(Sequence):
    """A sequence made of another one: everything is that of `source`, except what a subclass changes."""

    def __init__(self, source: Sequence) -> None:
        self._source = source
        self.name = source.name
        self.camera = source.camera
        self.timestamps = source.timestamps
        self.truth = source.truth
        self.volume_size = source.volume_size
        self.initial_position = source.initial_position
        self.fixed_size = source.fixed_size
        self.truth_axes = source.truth_axes

    def depth(self, index: int) -> npt.NDArray[np.uint16]:
        return self._source.depth(index)

    def colour(self, index: int) -> npt.NDArray[np.uint8] | None:
        return self._source.colour(index)

    @property
    def sha256(self) -> str:
        return self._source.sha256


def regular_timestamps(count: int) -> npt.NDArray[np.float64]:
    """Stamps of `count` frames at FRAME_RATE, from zero."""
    return np.arange(count) / FRAME_RATE


def read_truth(
    source: Path,
    camera: Camera,
    timestamps: npt.NDArray[np.float64],
    numbers: npt.NDArray[np.int64] | None = None,
) -> npt.NDArray[np.float64]:
    """The true pose of every frame, (n, 4, 4) in the axes of `camera`, from a TUM file.

    Files called *.freiburg are ICL-NUIM's, with y up: they are mirrored unless the camera is as well (fy
    below 0). Raises TrajectoryError when the file is not a trajectory, SequenceError when no pose matches a
    frame.
    """
    trajectory = Trajectory.read(source)
    if source.suffix == UPWARD_SUFFIX and camera.fy > 0:
        trajectory = Trajectory(trajectory.timestamps, mirror_y(trajectory.poses))
    return match_truth(trajectory, timestamps, numbers, source)


def match_truth(
    trajectory: Trajectory,
    timestamps: npt.NDArray[np.float64],
    numbers: npt.NDArray[np.int64] | None,
    source: Path,
) -> npt.NDArray[np.float64]:
    """The true pose of every frame, (n, 4, 4), NaN where `trajectory` has none.

    Stamps decide. Where the frames are only numbered (`numbers`) and the trajectory's stamps are whole,
    as in ICL-NUIM's files, those are frame numbers. Raises SequenceError when nothing matches,
    TrajectoryError for a pose that is not a rigid motion.
    """
    check_poses(trajectory.poses, source)
    stamps = trajectory.timestamps
    if numbers is not None and len(stamps) > 1 and np.all(stamps == np.rint(stamps)):
        frames, rows = associate(numbers.astype(np.float64), stamps, 0.5)
    else:
        frames, rows = associate(timestamps, stamps)
    if not len(frames):
        raise SequenceError(
            f"{source}: no pose matches a frame: its stamps run from {stamps.min():.3f} to "
            f"{stamps.max():.3f}, the frames' from {timestamps.min():.3f} to {timestamps.max():.3f} s"
        )
    truth = np.full((len(timestamps), 4, 4), np.nan)
    truth[frames] = trajectory.poses[rows]
    return truth


def make_camera(numbers: tuple[float, float, float, float], size: tuple[int, int], source: Path) -> Camera:
    """The camera fx, fy, cx, cy of images of (width, height); SequenceError when there is no such camera."""
    try:
        camera = Camera(*numbers, *size)
    except ValueError as error:
        raise SequenceError(f"{source}: {error}") from None
    check_camera(camera, source)
    return camera


def check_camera(camera: Camera, source: Path) -> None:
    """Raise SequenceError when the intrinsics cannot be those of images of this size.

    The principal point must lie inside the image and the focal lengths between a tenth and ten times its
    size: intrinsics of another resolution, in another order or divided by the size fail that. Images below
    SMALLEST_JUDGED are patterns made by hand, whose lens is not checked. No camera has an fx below 0; an fy
    below 0 mirrors y, as in ICL-NUIM. A side has at most LARGEST_SIDE pixels.
    """
    width, height = camera.width, camera.height
    if max(width, height) > LARGEST_SIDE:
        raise SequenceError(f"{source}: images of {width}x{height}: at most {LARGEST_SIDE} pixels a side")
    if camera.fx < 0:
        raise SequenceError(f"{source}: the focal length fx={camera.fx:g} must be above 0: give pixels")
    if max(width, height) < SMALLEST_JUDGED:
        return
    inside = 0 <= camera.cx <= width and 0 <= camera.cy <= height
    sound = 0.1 * width <= abs(camera.fx) <= 10 * width and 0.1 * height <= abs(camera.fy) <= 10 * height
    if inside and sound:
        return
    given = f"fx {camera.fx:g}, fy {camera.fy:g}, cx {camera.cx:g}, cy {camera.cy:g}"
    values = (abs(camera.fx), abs(camera.fy), camera.cx, camera.cy)
    remedy = (
        "they look divided by the size: give pixels"
        if max(values) < 5 < min(width, height)
        else "give pixels of this size, in the order fx,fy,cx,cy"
    )
    raise SequenceError(f"{source}: {given} do not fit images of {width}x{height}: {remedy}")
