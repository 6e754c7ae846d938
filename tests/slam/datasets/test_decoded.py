"""Depth that is decoded once and read from files afterwards."""

import numpy as np
import pytest

from slam.datasets.decoded import Decoded
from slam.datasets.sequence import Sequence
from tests.slam.sequences import ArraySequence


class Counting(ArraySequence):
    """Counts how often a frame was decoded."""

    decoded = 0

    def depth(self, index):
        self.decoded += 1
        return super().depth(index)


@pytest.fixture
def sequence() -> Counting:
    frames = np.arange(3 * 4 * 5).reshape(3, 4, 5) * 1000
    return Counting(frames, None, np.tile(np.eye(4), (3, 1, 1)))


def read(sequence: Sequence) -> list[np.ndarray]:
    return [sequence.depth(index) for index in range(len(sequence))]


def test_each_frame_is_decoded_once_for_all_later_readers(sequence, tmp_path):
    first, second = read(Decoded(sequence, tmp_path)), read(Decoded(sequence, tmp_path))

    assert sequence.decoded == 3
    np.testing.assert_array_equal(first, read(sequence))
    np.testing.assert_array_equal(second, first)
    assert second[0].dtype == np.uint16
    assert Decoded(sequence, tmp_path).sha256 == sequence.sha256


@pytest.mark.parametrize("damage", [b"", b"\x01", bytes(44), None])
def test_a_damaged_file_is_decoded_and_written_again(sequence, tmp_path, damage):
    read(Decoded(sequence, tmp_path))
    [path] = tmp_path.rglob("1.depth")
    path.write_bytes(path.read_bytes()[::-1] if damage is None else damage)

    again = read(Decoded(sequence, tmp_path))

    np.testing.assert_array_equal(again, read(sequence))
    assert sequence.decoded == 3 + 1 + 3
    read(Decoded(sequence, tmp_path))
    assert sequence.decoded == 3 + 1 + 3


def test_without_a_folder_that_can_be_written_frames_are_decoded_each_time(sequence, tmp_path):
    blocked = tmp_path / "a file"
    blocked.write_text("")

    for _ in range(2):
        np.testing.assert_array_equal(read(Decoded(sequence, blocked)), read(sequence))


def test_a_frame_outside_of_the_sequence_is_refused(sequence, tmp_path):
    with pytest.raises(IndexError, match="frame 3"):
        Decoded(sequence, tmp_path).depth(3)
