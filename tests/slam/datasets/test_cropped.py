import numpy as np
import pytest

from slam.datasets.cropped import cropped
from tests.slam.sequences import ArraySequence


def numbered(width, height):
    """A sequence of one frame in which every pixel has a depth and a colour of its own."""
    depth = np.arange(1, width * height + 1).reshape(1, height, width)
    return ArraySequence(depth, colour=np.repeat(depth[..., None] % 251, 3, axis=3).astype(np.uint8))


@pytest.mark.parametrize(
    ("size", "multiple", "cropped_size"), [((45, 30), 8, (40, 24)), ((41, 33), 4, (40, 32))]
)
def test_images_are_cropped_to_a_multiple_and_every_pixel_keeps_its_ray(size, multiple, cropped_size):
    whole = numbered(*size)
    part = cropped(whole, multiple)
    camera = part.camera
    assert (camera.width, camera.height) == cropped_size
    assert part.cropped_from == size
    pixel = np.argwhere(whole.depth(0) == part.depth(0)[3, 5])[0]
    assert (5 - camera.cx) / camera.fx == (pixel[1] - whole.camera.cx) / whole.camera.fx
    assert (3 - camera.cy) / camera.fy == (pixel[0] - whole.camera.cy) / whole.camera.fy
    np.testing.assert_array_equal(part.colour(0)[..., 0], part.depth(0) % 251)
    assert part.sha256 != whole.sha256


def test_margins_on_both_sides_differ_by_a_pixel_at_most():
    whole = numbered(45, 35)
    first, last = (
        np.argwhere(whole.depth(0) == value)[0] for value in cropped(whole, 8).depth(0).flat[[0, -1]]
    )
    assert first.tolist() == [1, 2]
    assert [34 - last[0], 44 - last[1]] == [2, 3]


def test_a_size_that_fits_is_fixed_or_is_smaller_than_the_multiple_stays():
    whole = numbered(40, 32)
    assert cropped(whole, 8) is whole
    assert cropped(whole, 64) is whole
    whole.fixed_size = True
    assert cropped(whole, 3) is whole
