import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from slam.datasets.formats import codec
from slam.datasets.sequence import SequenceError

depth_images = hnp.arrays(np.uint16, hnp.array_shapes(min_dims=3, max_dims=3, max_side=12))


@pytest.mark.slow
@given(depth_images)
def test_any_depth_images_survive(frames):
    chunk = codec.encode(list(frames))
    for index, frame in enumerate(frames):
        np.testing.assert_array_equal(codec.decode(chunk, index, frame.shape[1], frame.shape[0]), frame)


def test_all_65536_values_survive():
    frame = np.random.default_rng(0).permutation(2**16).astype(np.uint16).reshape(256, 256)
    np.testing.assert_array_equal(codec.decode(codec.encode([frame]), 0, 256, 256), frame)


@given(st.binary(max_size=200))
def test_arbitrary_bytes_are_refused_or_decode_to_an_image(data):
    try:
        frame = codec.decode(data, 0, 4, 3)
    except SequenceError:
        return
    assert frame.shape == (3, 4)


def test_a_chunk_of_another_size_is_refused():
    chunk = codec.encode([np.ones((6, 8), np.uint16)])
    for width, height in [(8, 5), (8, 7), (80, 60)]:
        with pytest.raises(SequenceError, match="damaged"):
            codec.decode(chunk, 0, width, height)


def test_a_chunk_cut_short_is_refused():
    frames = [np.arange(48, dtype=np.uint16).reshape(6, 8)] * 2
    chunk = codec.encode(frames)
    with pytest.raises(SequenceError, match="frame 1"):
        codec.decode(chunk[:-3], 1, 8, 6)
