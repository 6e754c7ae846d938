"""A damaged input either opens to sane data or is refused with a typed error: nothing else happens."""

from __future__ import annotations

import contextlib
import json
import os
import random
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.__main__ import main
from slam.camera import Camera
from slam.datasets import SequenceError, open_sequence
from slam.datasets.conversion import write
from slam.datasets.formats import images, pack
from slam.trajectories.trajectory import Trajectory, TrajectoryError, check_poses
from tests.slam.datasets.formats.damage import damage_pack, of_kind
from tests.slam.sequences import ArraySequence, random_poses

FRAMES, HEIGHT, WIDTH = 4, 36, 48
CAMERA = Camera(40.0, 41.0, 23.5, 17.5, WIDTH, HEIGHT)
FOUR = (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
FORMS = (
    "tum",
    "tum-listed",
    "icl",
    "icl-original",
    "raw",
    "slam",
    "slam3",
    "pack",
    "trajectory",
    "open3d",
    "seven-scenes",
)
EXAMPLES = int(os.environ.get("FRONTRUNNER_FUZZ", "200"))  # of each form
seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """A folder with a small sequence in each form."""
    rng = np.random.default_rng(5)
    depth = rng.integers(400, 4000, (FRAMES, HEIGHT, WIDTH))
    colour = rng.integers(0, 256, (FRAMES, HEIGHT, WIDTH, 3)).astype(np.uint8)
    source = ArraySequence(
        depth, colour, random_poses(FRAMES, rng), volume_size=4.8, initial_position=(0.5, 0.5, 0)
    )
    source.camera = CAMERA
    folder = tmp_path_factory.mktemp("sound")
    for form in FORMS:
        (folder / form).mkdir()
        if form == "trajectory":
            Trajectory(source.timestamps, source.truth).write(folder / form / "poses.txt")
        elif form == "open3d":
            write_open3d(source, folder / form / "room")
        elif form == "seven-scenes":
            write_seven_scenes(source, folder / form / "room")
        else:
            suffix = {"raw": ".raw", "slam": ".slam", "slam3": ".slam"}.get(form, "")
            write(source, folder / form / f"room{suffix}", form.removesuffix("-listed"), colour=True)
    for name in ("depth.txt", "rgb.txt"):  # the one form has lists, the other names alone
        (folder / "tum/room" / name).unlink()
    return folder


def write_open3d(source, folder):
    write(source, folder, "tum")
    for name in ("intrinsics.txt", "depth.txt", "rgb.txt", "groundtruth.txt"):
        (folder / name).unlink()
    (folder / "rgb").rename(folder / "color")
    matrix = [CAMERA.fx, 0, 0, 0, CAMERA.fy, 0, CAMERA.cx, CAMERA.cy, 1]
    described = {"width": WIDTH, "height": HEIGHT, "intrinsic_matrix": matrix, "depth_scale": 1000}
    (folder / "intrinsic.json").write_text(json.dumps(described))


def write_seven_scenes(source, folder):
    folder.mkdir()
    for frame in range(FRAMES):
        stem = folder / f"frame-{frame:06d}"
        images.write_depth(stem.with_suffix(".depth.png"), source.depth(frame))
        images.write_colour(stem.with_suffix(".color.png"), source.colour(frame))
        np.savetxt(stem.with_suffix(".pose.txt"), source.truth[frame])


@pytest.mark.parametrize("form", FORMS)
def test_what_the_damage_begins_with_is_sound(sound, form):
    opened = opened_and_checked(sound / form)
    assert opened == FRAMES


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
@given(seed=seeds)
@settings(max_examples=EXAMPLES, derandomize=True, deadline=None, database=None)
def test_a_damaged_input_is_sane_or_refused(sound, tmp_path_factory, form, seed):
    rng = random.Random(seed)
    folder = tmp_path_factory.getbasetemp() / "damaged" / form
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(sound / form, folder)
    if form == "pack":
        damage_pack(folder / rng.choice(("room", "room", "room", "room-colour")), rng)
    else:
        path = rng.choice(sorted(path for path in folder.rglob("*") if path.is_file()))
        path.write_bytes(of_kind(path)(path.read_bytes(), rng))
    with warnings.catch_warnings(action="error"), contextlib.suppress(SequenceError, TrajectoryError):
        opened_and_checked(folder)


def opened_and_checked(folder: Path) -> int:
    """Open what lies in `folder`, read all of it and check that it is sane; returns how many frames it
    has."""
    if folder.name == "trajectory":
        trajectory = Trajectory.read(folder / "poses.txt")
        assert np.isfinite(trajectory.timestamps).all()
        assert np.isfinite(trajectory.poses).all()
        check_poses(trajectory.poses, folder)
        return len(trajectory)
    path = min(folder.glob("room*"))
    camera = {"raw": FOUR, "icl-original": CAMERA, "seven-scenes": FOUR}.get(folder.name)
    sequence = open_sequence(path, camera)
    assert len(sequence) >= 1
    assert sequence.timestamps.shape == (len(sequence),)
    assert np.isfinite(sequence.timestamps).all()
    assert isinstance(sequence.name, str)
    found = sequence.camera
    assert found.fx > 0
    assert np.isfinite([found.fx, found.fy, found.cx, found.cy]).all()
    if sequence.truth is not None:
        assert sequence.truth.shape == (len(sequence), 4, 4)
        check_poses(sequence.truth, path)
    if sequence.volume_size is not None:
        assert 0 < sequence.volume_size < float("inf")
    if sequence.initial_position is not None:
        assert np.isfinite(sequence.initial_position).all()
    for index in range(len(sequence)):
        depth, colour = sequence.depth(index), sequence.colour(index)
        assert (depth.shape, depth.dtype) == ((found.height, found.width), np.uint16)
        if colour is not None:
            assert (colour.shape, colour.dtype) == ((found.height, found.width, 3), np.uint8)
    assert len(sequence.sha256) == 64
    return len(sequence)


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("intrinsics.txt", "40 41 23.5 17.5 inf 36 1000", "width inf is not a whole number of pixels"),
        ("intrinsics.txt", "40 41 23.5 17.5 48 36.5 1000", "height 36.5 is not a whole number of pixels"),
        ("intrinsics.txt", "40 41 23.5 17.5 48 36 inf", "inf depth units a metre: must be above 0"),
        ("intrinsics.txt", "-40 41 23.5 17.5 48 36 1000", "the focal length fx=-40 must be above 0"),
        ("intrinsics.txt", "40 -41 23.5 17.5 48 36 1000", "the focal length fy=-41 must be above 0"),
        ("groundtruth.txt", "0 0 0 1e308 0 0 0 1", "is out of range"),
        ("groundtruth.txt", "0 0 0 0 0 0 0 1", None),
    ],
)  # fmt: skip
def test_an_impossible_value_is_one_line_on_the_command_line(sound, tmp_path, capsys, file, text, message):
    folder = shutil.copytree(sound / "tum/room", tmp_path / "room")
    (folder / file).write_text(text + "\n")
    expected = 0 if message is None else 2
    assert main(["datasets", "info", str(folder)]) == expected
    error = capsys.readouterr().err
    if message is not None:
        assert message in error
        assert error.count("\n") == 1


@pytest.mark.parametrize("file", ["intrinsics.txt", "groundtruth.txt", "depth.txt"])
def test_text_in_utf_16_names_the_file_and_the_remedy(sound, tmp_path, capsys, file):
    folder = shutil.copytree(sound / "tum-listed/room", tmp_path / "room")
    (folder / file).write_text((folder / file).read_text(), encoding="utf-16")
    assert main(["run", "--sequence", str(folder)]) == 2
    error = capsys.readouterr().err
    assert f"{folder / file} is text in UTF-16" in error
    assert "save it as UTF-8" in error


def test_text_with_a_byte_order_mark_reads_as_without(sound, tmp_path):
    folder = shutil.copytree(sound / "tum-listed/room", tmp_path / "room")
    for file in ("intrinsics.txt", "groundtruth.txt", "depth.txt"):
        (folder / file).write_text((folder / file).read_text(), encoding="utf-8-sig")
    sequence = open_sequence(folder)
    assert len(sequence) == FRAMES
    np.testing.assert_array_equal(sequence.truth, open_sequence(sound / "tum-listed/room").truth)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frames_per_chunk": 0}, "frames_per_chunk is 0: must be a whole number from 1 to"),
        ({"frames_per_chunk": 2}, "take 3 chunks, it has 2"),
        ({"volume_size": "x"}, "volume_size is 'x': must be metres"),
        ({"volume_size": -4.8}, "volume_size is -4.8: must be metres"),
        ({"initial_position": [0.5, None, 0]}, "must be three finite numbers"),
        ({"timestamps": [0, 1, 2, 1e308]}, "a timestamp is 1e.308: must be seconds"),
        ({"truth": [[0.0] * 12] * 4}, "true pose of frame 0 is not a pose: its 3x3 part is not a rotation"),
        ({"truth": [None, [1e308] * 12, None, None]}, "the true pose of frame 1"),
        ({"camera": {"fx": 40}}, "must be an object with fx, fy"),
    ],
)  # fmt: skip
def test_a_pack_that_describes_itself_wrongly_is_refused(sound, tmp_path, change, message):
    source = open_sequence(sound / "pack/room")
    header = pack._header(source, "depth") | change
    pack._write(tmp_path, header, iter([b"depth"]))
    with pytest.raises((SequenceError, TrajectoryError), match=message):
        open_sequence(tmp_path)
