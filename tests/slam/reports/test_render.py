import numpy as np
import pytest

from slam.benchmark import run
from slam.datasets import open_sequence
from slam.datasets.formats.images import read_colour
from slam.reports.render import BACKGROUND, Renderer, shade
from slam.system import View
from tests.shipped import LIVING_ROOM


def wall(normal):
    """A view of three pixels at a wall one metre ahead, whose middle one sees nothing."""
    vertices = np.array([[[0, 0, 1], [0, 0, 0], [0, 0, 1]]], np.float32)
    normals = np.array([[normal, [0, 0, 0], normal]], np.float32)
    return View(vertices, normals, eye=np.zeros(3, np.float32))


def test_a_wall_seen_from_the_front_is_bright_and_an_oblique_one_is_darker():
    front = shade(wall([0, 0, -1]))
    oblique = shade(wall([0.8, 0, -0.6]))
    assert front.shape == (1, 3, 3)
    assert front[0, 0].min() > 200
    assert 100 < oblique[0, 0].mean() < front[0, 0].mean() - 50
    assert tuple(front[0, 1]) == BACKGROUND


def test_every_nth_frame_of_a_run_becomes_a_picture_once_there_is_a_model(tmp_path):
    renderer = Renderer(tmp_path / "views", every=2)
    configuration = {"compute_size_ratio": 4, "volume_resolution": 128}
    run(configuration, open_sequence(LIVING_ROOM), frames=7, observe=renderer)
    assert sorted(path.name for path in (tmp_path / "views").iterdir()) == ["000004.png", "000006.png"]
    assert renderer.written == 2
    picture = read_colour(tmp_path / "views/000006.png")
    assert picture.shape == (120, 160, 3)
    drawn = (picture != BACKGROUND).any(axis=2)
    assert drawn.mean() > 0.7
    assert picture[drawn].std() > 20


def test_a_folder_that_cannot_be_made_is_an_error_before_the_run(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        Renderer(tmp_path / "file" / "views", every=1)
