import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.__main__ import main
from slam.datasets import SequenceError, open_sequence
from slam.datasets.conversion import FORMATS, check_target, form_of, write
from slam.datasets.formats import tum
from slam.datasets.formats.slambench import raw_file
from slam.trajectories.trajectory import Trajectory
from tests.slam.sequences import ArraySequence, random_poses

pytest.importorskip("cv2", reason="image folders need OpenCV")


def sequence(seed=0, frames=3, **scene):
    rng = np.random.default_rng(seed)
    depth = rng.integers(0, 13000, (frames, 6, 8))
    colour = rng.integers(0, 256, (frames, 6, 8, 3)).astype(np.uint8)
    return ArraySequence(depth, colour, random_poses(frames, rng), **scene)


def reopen(path, form, source):
    c = source.camera
    if form == "raw":
        Trajectory(source.timestamps, source.truth).write(path.with_suffix(".txt"))
        return open_sequence(path, (c.fx, c.fy, c.cx, c.cy), path.with_suffix(".txt"))
    return open_sequence(path, c if form == "icl-original" else None)


@given(st.integers(0, 1000), st.sampled_from(FORMATS), st.sampled_from(FORMATS))
@settings(max_examples=40)
def test_every_form_through_every_other_keeps_depth_and_truth(tmp_path_factory, seed, first, second):
    folder = tmp_path_factory.mktemp("convert")
    source = sequence(seed)
    suffixes = {"raw": ".raw", "slam": ".slam", "slam3": ".slam"}
    opened = source
    for number, form in enumerate((first, second)):
        path = folder / f"room{number}{suffixes.get(form, '')}"
        write(opened, path, form)
        opened = reopen(path, form, source)
    assert len(opened) == 3
    np.testing.assert_allclose(opened.truth, source.truth, atol=1e-6)
    np.testing.assert_allclose(opened.timestamps, source.timestamps, atol=1e-6)
    for index in range(3):
        np.testing.assert_array_equal(opened.depth(index), source.depth(index))
        if "pack" not in (first, second):
            np.testing.assert_array_equal(opened.colour(index), source.colour(index))


def test_the_suffix_names_the_form_unless_one_is_given(tmp_path):
    forms = [form_of(tmp_path / name) for name in ("a.raw", "a.slam", "a", "a.x")]
    assert forms == ["raw", "slam", "pack", "pack"]
    assert form_of(tmp_path / "a.slam", "slam3") == "slam3"


def test_what_a_form_cannot_hold_is_said(tmp_path):
    source = sequence(volume_size=4.8, initial_position=(0.5, 0.5, 0.1))
    source.timestamps = np.arange(3.0)
    notes = " ".join(write(source, tmp_path / "a.raw", "raw"))
    assert "--camera 6.4,6.48,3.5,2.5" in notes
    assert "no truth" in notes
    assert "no stamps" in notes
    assert "--volume-size" in notes
    assert write(source, tmp_path / "pack", "pack") == []
    far = ArraySequence([[[20000]]])
    assert "13.107 m" in write(far, tmp_path / "icl", "icl")[0]


def test_a_target_that_would_destroy_something_is_refused(tmp_path):
    full = tmp_path / "full"
    full.mkdir()
    (full / "x").touch()
    with pytest.raises(SequenceError, match="is the source itself"):
        check_target(full, tmp_path / "full/../full", "tum")
    with pytest.raises(SequenceError, match="is not empty"):
        check_target(tmp_path, full, "icl-original")
    with pytest.raises(SequenceError, match="is a folder, the form raw is one file"):
        check_target(tmp_path, full, "raw")
    with pytest.raises(SequenceError, match="is a file, the form tum is a folder"):
        check_target(tmp_path, full / "x", "tum")
    with pytest.raises(SequenceError, match="there is no folder"):
        check_target(tmp_path, tmp_path / "none/a.slam", "slam")


def test_a_folder_of_ones_own_goes_in_with_four_numbers(tmp_path, capsys):
    """Images and nothing else: the size is theirs, the camera is given, and the result is a .slam file."""
    tum.write(sequence(), tmp_path / "own")
    (tmp_path / "own/intrinsics.txt").unlink()
    arguments = ["datasets", "convert", str(tmp_path / "own"), str(tmp_path / "own.slam")]
    assert main([*arguments, "--camera", "7,7,4,3"]) == 0
    opened = open_sequence(tmp_path / "own.slam")
    assert (opened.camera.fx, opened.camera.width, opened.camera.height) == (7, 8, 6)
    assert "3 frames" in capsys.readouterr().out


def broken(tmp_path, kind):
    """A sequence with one defect, as the command line takes it."""
    tum.write(sequence(), tmp_path / "room")
    depth = tmp_path / "room/depth/000001.png"
    data = depth.read_bytes()
    if kind == "cut":
        depth.write_bytes(data[: len(data) // 2])
    elif kind == "flipped":
        depth.write_bytes(data[:60] + bytes([data[60] ^ 255]) + data[61:])
    elif kind == "text":
        depth.write_bytes(b"hello")
    elif kind == "gone":
        depth.unlink()
    elif kind == "size":
        other = ArraySequence([[[1, 2], [3, 4]]])
        tum.write(other, tmp_path / "other")
        depth.write_bytes((tmp_path / "other/depth/000000.png").read_bytes())
    elif kind == "resized":
        (tmp_path / "room/intrinsics.txt").write_text("7 7 4 3 640 480 1000")
    return [str(tmp_path / "room")]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("cut", "000001.png is cut short after"),
        ("flipped", "000001.png is damaged between bytes"),
        ("text", "000001.png is not a readable image"),
        ("gone", "000001.png cannot be read: No such file"),
        ("size", "000001.png is 2x2, the camera says 8x6"),
        ("resized", "000000.png is 8x6, the camera says 640x480"),
    ],
)
def test_a_defect_is_one_line_and_nothing_is_written(tmp_path, kind, message):
    """In a process of its own, since libpng writes to standard error behind Python's back."""

    source = broken(tmp_path, kind)
    target = tmp_path / "out.slam"
    command = [sys.executable, "-m", "slam", "datasets", "convert", *source, str(target)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert not target.exists()


@pytest.mark.parametrize("form", FORMATS)
def test_nothing_is_left_of_a_conversion_that_fails(tmp_path, form):
    (source,) = broken(tmp_path, "cut")
    with pytest.raises(SequenceError, match="cut short"):
        write(open_sequence(source), tmp_path / "new", form)
    assert [path.name for path in tmp_path.iterdir()] == ["room"]


def test_a_truncated_raw_names_the_frame(tmp_path):
    path = tmp_path / "a.raw"
    raw_file.write(sequence(), path)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(SequenceError, match="cut short in frame 2"):
        open_sequence(path, (7, 7, 4, 3))


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ((0.75, 1.0, 0.5, 0.5), "look divided by the size"),
        ((481.2, 480, 319.5, 239.5), "do not fit images of 80x60"),
        ((39.5, 29.5, 481.2, 480), "do not fit images of 80x60"),
        ((0.0, 60, 39.5, 29.5), "no field of view"),
        ((float("nan"), 60, 39.5, 29.5), "finite"),
    ],
)
def test_intrinsics_that_do_not_fit_are_refused(tmp_path, camera, message):
    raw_file.write(ArraySequence(np.ones((1, 60, 80))), tmp_path / "a.raw")
    with pytest.raises(SequenceError, match=message):
        open_sequence(tmp_path / "a.raw", camera)
    assert len(open_sequence(tmp_path / "a.raw", (60, -60, 39.5, 29.5))) == 1


def test_the_base_installation_reads_what_needs_no_images(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    for form, name in (("pack", "pack"), ("raw", "a.raw"), ("slam", "a.slam")):
        write(sequence(), tmp_path / name, form)
        opened = reopen(tmp_path / name, form, sequence())
        np.testing.assert_array_equal(opened.depth(2), sequence().depth(2))
