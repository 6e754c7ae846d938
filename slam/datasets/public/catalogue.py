"""Public sequences that `datasets get` knows: their addresses, their licences, and how to cite them.

No publisher of these gives checksums, so there are none here; download.py says what it does instead.
"""

from __future__ import annotations

from dataclasses import dataclass

from slam.camera import Camera
from slam.datasets.sequence import SequenceError


@dataclass(frozen=True)
class Entry:
    """A sequence to download. `size` is the archive's length in bytes where known, for display only.

    `sha256` is the digest that the publisher gives, or None. `camera` is given where the files do not contain
    it and the reader does not know it.
    """

    name: str
    address: str
    page: str
    licence: str
    citation: str
    size: int | None = None
    sha256: str | None = None
    camera: Camera | None = None
    depth_units: float = 5000


_ICL = "https://www.doc.ic.ac.uk/~ahanda/"
_TUM = "https://cvg.cit.tum.de/"
# TUM recommends these for the sequences whose depth was registered and not undistorted, freiburg1 and 2.
_TUM_CAMERA = Camera(525.0, 525.0, 319.5, 239.5, 640, 480)
_TUM_CAMERA_3 = Camera(535.4, 539.2, 320.1, 247.6, 640, 480)


def _icl(name: str, archive: str, size: int | None = None) -> Entry:
    return Entry(
        name=name,
        address=f"{_ICL}{archive}",
        page=f"{_ICL}VaFRIC/iclnuim.html",
        licence="CC BY 3.0",
        citation="A. Handa, T. Whelan, J. McDonald, A. J. Davison: A Benchmark for RGB-D Visual Odometry, "
        "3D Reconstruction and SLAM. ICRA 2014",
        size=size,
    )


def _tum(name: str, camera: int, sequence: str, size: int | None = None) -> Entry:
    return Entry(
        name=name,
        address=f"{_TUM}rgbd/dataset/freiburg{camera}/rgbd_dataset_freiburg{camera}_{sequence}.tgz",
        page=f"{_TUM}data/datasets/rgbd-dataset",
        licence="CC BY 4.0",
        citation="J. Sturm, N. Engelhard, F. Endres, W. Burgard, D. Cremers: A Benchmark for the Evaluation "
        "of RGB-D SLAM Systems. IROS 2012",
        size=size,
        camera=_TUM_CAMERA_3 if camera == 3 else _TUM_CAMERA,
    )


ENTRIES = {
    entry.name: entry
    for entry in (
        _icl("icl-kt0", "living_room_traj0_frei_png.tar.gz", 711_444_709),
        _icl("icl-kt1", "living_room_traj1_frei_png.tar.gz"),
        _icl("icl-kt2", "living_room_traj2_frei_png.tar.gz"),
        _icl("icl-kt3", "living_room_traj3_frei_png.tar.gz"),
        _icl("icl-kt0-original", "living_room_traj0_loop.tgz"),
        _icl("icl-kt1-original", "living_room_traj1_loop.tgz"),
        _icl("icl-kt2-original", "living_room_traj2_loop.tgz"),
        _icl("icl-kt3-original", "living_room_traj3_loop.tgz"),
        _tum("fr1_xyz", 1, "xyz", 448_204_271),
        _tum("fr1_desk", 1, "desk", 344_011_403),
        _tum("fr1_room", 1, "room"),
        _tum("fr2_xyz", 2, "xyz"),
        _tum("fr2_desk", 2, "desk"),
        _tum("fr3_office", 3, "long_office_household"),
    )
}


def find(name: str) -> Entry:
    """The entry of this name. Raises SequenceError, which lists the known ones."""
    if name not in ENTRIES:
        raise SequenceError(f"no public sequence {name!r} is known here: choose one of {', '.join(ENTRIES)}")
    return ENTRIES[name]
