"""Packs of synthetic scenes, made once and reused, for searches over several sequences."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from groundwork.folders import SEQUENCES, data_folder
from slam.datasets.formats import pack
from slam.datasets.formats.pack import MANIFEST, Pack
from slam.datasets.sequence import Progress, Sequence, SequenceError
from slam.datasets.synthetic.camera_paths import SEED
from slam.datasets.synthetic.rendering import Noise, SyntheticSequence
from slam.datasets.synthetic.scenes import SyntheticScene

# Mathematical libraries differ in the last digit, so a few pixels of a frame differ, too.
MOST_DIFFERENT = 0.001  # share of the pixels that may differ by more than 1 mm


def default_folder() -> Path:
    """`sequences` in the data folder, where a server looks for packs, too."""
    return data_folder() / "sequences"


def make_all(
    scenes: Iterable[SyntheticScene],
    folder: Path,
    frames: int | None = None,
    noise: Noise = "kinect",
    seed: int = SEED,
    ratio: int = 1,
    progress: Callable[[str], Progress | None] = lambda _name: None,
) -> list[Path]:
    """Return the pack of each scene, in their order: the shipped one, one in `folder`, or a new one there.

    An existing pack is used when its header and its middle frame are those that would be rendered; otherwise
    it is made again. `frames`, `noise`, `seed` and `ratio` are those of SyntheticSequence. `progress` is
    called with a scene's name before it is rendered. Raises SequenceError where `folder` cannot be written.
    """
    paths = []
    for scene in scenes:
        wanted = SyntheticSequence(scene, frames, noise, seed, ratio)
        path = next((p for p in (SEQUENCES / scene.name, folder / scene.name) if is_same(p, wanted)), None)
        if path is None:
            path = folder / scene.name
            try:
                pack.write(wanted, path, progress(scene.name))
            except OSError as error:
                raise SequenceError(f"{path} cannot be written: {error}") from None
        paths.append(path)
    return paths


def is_same(path: Path, wanted: Sequence) -> bool:
    """Whether the pack `path` holds the sequence `wanted`, by its header and its middle frame."""
    if not (path / MANIFEST).exists():
        return False
    try:
        stored = Pack(path)
        middle = stored.depth(len(stored) // 2)
    except SequenceError:
        return False
    described = (stored.name, stored.camera, stored.volume_size, stored.initial_position)
    if described != (wanted.name, wanted.camera, wanted.volume_size, wanted.initial_position):
        return False
    if stored.truth is None or wanted.truth is None or stored.truth.shape != wanted.truth.shape:
        return False
    if not np.allclose(stored.truth, wanted.truth, rtol=0, atol=1e-9):
        return False
    difference = np.abs(middle.astype(int) - wanted.depth(len(wanted) // 2))
    return bool(np.mean(difference > 1) <= MOST_DIFFERENT)
