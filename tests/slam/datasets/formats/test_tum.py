import sys

import numpy as np
import pytest

from slam.camera import Camera
from slam.datasets import SequenceError, open_sequence
from slam.datasets.formats import images, pack, tum
from tests.slam.real import DATA, needs_real_data
from tests.slam.sequences import ArraySequence, random_poses

pytest.importorskip("cv2", reason="image folders need OpenCV")


def folder(path, names, intrinsics="8 8 3.5 2.5 8 6 1000", value=1500):
    (path / "depth").mkdir(parents=True)
    for number, name in enumerate(names):
        images.write_depth(path / "depth" / name, np.full((6, 8), value + number, np.uint16))
    if intrinsics:
        (path / "intrinsics.txt").write_text(intrinsics)
    return path


def test_a_written_folder_reads_back(tmp_path):
    rng = np.random.default_rng(0)
    depth = rng.integers(0, 9000, (4, 6, 8))
    colour = rng.integers(0, 256, (4, 6, 8, 3)).astype(np.uint8)
    source = ArraySequence(depth, colour, random_poses(4, rng))
    tum.write(source, tmp_path / "room")
    again = open_sequence(tmp_path / "room")
    assert again.name == "room"
    assert again.camera == source.camera
    np.testing.assert_allclose(again.timestamps, source.timestamps, atol=1e-6)
    np.testing.assert_allclose(again.truth, source.truth, atol=1e-8)
    for index in range(4):
        np.testing.assert_array_equal(again.depth(index), depth[index])
        np.testing.assert_array_equal(again.colour(index), colour[index])


def test_depth_units_become_millimetres_and_what_overflows_is_not_measured(tmp_path):
    path = folder(tmp_path, ["0.png"], "8 8 3.5 2.5 8 6 5000", value=7503)
    assert open_sequence(path).depth(0)[0, 0] == 1501
    (path / "intrinsics.txt").write_text("8 8 3.5 2.5 8 6 100")
    assert open_sequence(path).depth(0)[0, 0] == 0


def test_numbered_frames_run_in_numerical_order_at_30_hertz(tmp_path):
    path = folder(tmp_path, ["0.png", "2.png", "10.png"])
    sequence = open_sequence(path)
    np.testing.assert_allclose(sequence.timestamps, [0, 2 / 30, 10 / 30])
    assert [int(sequence.depth(i)[0, 0]) for i in range(3)] == [1500, 1501, 1502]


def test_file_names_that_are_stamps_are_stamps(tmp_path):
    path = folder(tmp_path, ["1305031102.160407.png", "1305031102.194330.png"])
    np.testing.assert_allclose(open_sequence(path).timestamps, [1305031102.160407, 1305031102.194330])


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("depth.txt", "# stamp file\n0.5 depth/b.png\n0.4 depth/a.png\n"),
        ("associations.txt", "0.5 depth/b.png 0.51 rgb/b.png\n0.4 depth/a.png 0.41 rgb/a.png\n"),
        ("associations.txt", "0.41 rgb/a.png 0.4 depth/a.png\n0.51 rgb/b.png 0.5 depth/b.png\n"),
    ],
)
def test_lists_give_stamps_and_order(tmp_path, file, text):
    path = folder(tmp_path, ["a.png", "b.png"])
    (path / file).write_text(text)
    sequence = open_sequence(path)
    assert sequence.timestamps.tolist() == [0.4, 0.5]
    assert [int(sequence.depth(i)[0, 0]) for i in range(2)] == [1500, 1501]


def test_stamps_written_without_a_point_are_frame_numbers_and_others_seconds(tmp_path):
    path = folder(tmp_path, ["a.png", "b.png"])
    for numbers, seconds in (("0 3", [0, 0.1]), ("0.0 3.0", [0, 3])):
        first, second = numbers.split()
        (path / "depth.txt").write_text(f"{first} depth/a.png\n{second} depth/b.png\n")
        np.testing.assert_allclose(open_sequence(path).timestamps, seconds)


def test_truth_is_matched_by_stamp_and_missing_frames_stay_unknown(tmp_path):
    path = folder(tmp_path, ["0.png", "1.png", "2.png"])
    (path / "groundtruth.txt").write_text("0.034 1 2 3 0 0 0 1\n0.2 9 9 9 0 0 0 1\n")
    truth = open_sequence(path).truth
    assert np.isnan(truth[[0, 2]]).all()
    assert truth[1, :3, 3].tolist() == [1, 2, 3]


def test_truth_of_another_recording_is_refused(tmp_path):
    path = folder(tmp_path, ["0.png"])
    (path / "groundtruth.txt").write_text("1305031098.67 1 2 3 0 0 0 1\n")
    with pytest.raises(SequenceError, match="no pose matches a frame"):
        open_sequence(path)


@pytest.mark.parametrize(
    ("intrinsics", "message"),
    [
        ("", "is missing"),
        ("8 8 3.5 2.5 8 6", "write seven numbers"),
        ("8 8 a 2.5 8 6 1000", "write seven numbers"),
        ("0 8 3.5 2.5 8 6 1000", "no field of view"),
        ("8 8 3.5 2.5 8 6 0", "must be above 0"),
    ],
)
def test_intrinsics_that_say_nothing_are_refused(tmp_path, intrinsics, message):
    with pytest.raises(SequenceError, match=message):
        open_sequence(folder(tmp_path, ["0.png"], intrinsics))


def test_a_folder_of_the_benchmark_itself_needs_a_camera_and_has_5000_units_a_metre(tmp_path):
    path = folder(tmp_path, ["0.png"], intrinsics="", value=5000)
    assert open_sequence(path, Camera(8, 8, 3.5, 2.5, 8, 6)).depth(0)[0, 0] == 1000


def test_images_that_do_not_fit_are_refused(tmp_path):
    path = folder(tmp_path, ["0.png", "1.png", "2.png"])
    images.write_depth(path / "depth/1.png", np.ones((3, 3), np.uint16))
    images.write_colour(path / "depth/2.png", np.ones((6, 8, 3), np.uint8))
    sequence = open_sequence(path)
    with pytest.raises(SequenceError, match="is 3x3, the camera says 8x6"):
        sequence.depth(1)
    with pytest.raises(SequenceError, match="one channel of 16 bits"):
        sequence.depth(2)


def test_an_empty_folder_and_a_path_to_nothing_say_what_is_expected(tmp_path):
    (tmp_path / "depth").mkdir()
    (tmp_path / "intrinsics.txt").write_text("8 8 3.5 2.5 8 6 1000")
    with pytest.raises(SequenceError, match="holds no image"):
        open_sequence(tmp_path)
    with pytest.raises(SequenceError, match="does not exist"):
        open_sequence(tmp_path / "nowhere")
    (tmp_path / "notes.md").write_text("hello")
    with pytest.raises(SequenceError, match="not a known sequence"):
        open_sequence(tmp_path / "notes.md")


def test_without_opencv_the_message_names_the_remedy_and_packs_still_work(tmp_path, monkeypatch):
    sequence = open_sequence(folder(tmp_path / "room", ["0.png"]))
    packed = pack.write(sequence, tmp_path / "packed")
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(SequenceError, match="pip install opencv-python-headless"):
        sequence.depth(0)
    assert packed.depth(0)[0, 0] == 1500


def test_the_largest_number_means_not_measured(tmp_path):
    path = folder(tmp_path, ["0.png"], value=65535)
    assert open_sequence(path).depth(0).max() == 0


def test_the_digest_follows_the_content_and_not_the_name(tmp_path):
    one = open_sequence(folder(tmp_path / "one", ["0.png"])).sha256
    assert open_sequence(folder(tmp_path / "two", ["0.png"])).sha256 == one
    assert open_sequence(folder(tmp_path / "other", ["0.png"], value=7)).sha256 != one


@needs_real_data
@pytest.mark.parametrize(
    ("name", "frames", "true_frames", "furthest"),
    [
        ("redkitchen", 300, 300, 9000),
        ("icl_livingroom1_micro", 211, 0, 9000),
        ("icl_livingroom2_first4", 4, 4, 9000),
    ],
)
def test_real_folders_open(name, frames, true_frames, furthest):
    sequence = open_sequence(DATA / "rgbd" / name)
    assert len(sequence) == frames
    known = 0 if sequence.truth is None else np.isfinite(sequence.truth).all(axis=(1, 2)).sum()
    assert known == true_frames
    for index in (0, frames - 1):
        depth = sequence.depth(index)
        assert depth.shape == (480, 640)
        assert 300 < np.median(depth[depth > 0]) < 4000
        assert depth.max() < furthest
        assert sequence.colour(index).shape == (480, 640, 3)


NANOSECONDS = ("1403636579763555584", "1403636579796888832")


@pytest.mark.parametrize("listing", [False, True])
def test_stamps_in_nanoseconds_are_read_from_names_and_lists_and_match_the_truth(tmp_path, listing):
    path = folder(tmp_path, [f"{stamp}.png" for stamp in NANOSECONDS])
    if listing:
        lines = [f"{stamp} depth/{stamp}.png\n" for stamp in NANOSECONDS]
        (path / "depth.txt").write_text("".join(lines))
    poses = [f"{stamp} {place} 0 0 0 0 0 1\n" for place, stamp in enumerate(NANOSECONDS)]
    (path / "groundtruth.txt").write_text("".join(poses))
    sequence = open_sequence(path)
    np.testing.assert_allclose(sequence.timestamps, [1403636579.763555584, 1403636579.796888832], atol=1e-6)
    assert sequence.truth[:, 0, 3].tolist() == [0, 1]
