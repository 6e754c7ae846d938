import contextlib
import io
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from slam.__main__ import main
from slam.definitions import SYSTEMS
from slam.reports.surface import Grid, SurfaceError, figures, table
from tests.shipped import LIVING_ROOM

SPACES = Path(__file__).resolve().parents[3] / "pareto/spaces"
QUICK = ["--set", "compute_size_ratio=8", "--set", "volume_resolution=64", "--frames", "6"]


def command(out, *extra, values=("0.1,0.2", "1e-5,1")):
    grid = ["--x", "mu", "--y", "icp_threshold", "--x-values", values[0], "--y-values", values[1]]
    return ["surface", *grid, "--sequence", str(LIVING_ROOM), "--out", str(out), *QUICK, *extra]


@pytest.fixture(scope="module")
def first_grid(tmp_path_factory) -> tuple[Path, str]:
    """A folder with a grid of four points, and what its measurement printed."""
    folder, printed = tmp_path_factory.mktemp("surface"), io.StringIO()
    with contextlib.redirect_stdout(printed):
        assert main(command(folder)) == 0
    return folder, printed.getvalue()


@pytest.fixture
def measured(first_grid, tmp_path) -> Path:
    """The same in a folder of the test."""
    return shutil.copytree(first_grid[0], tmp_path, dirs_exist_ok=True)


@pytest.mark.slow
def test_a_grid_is_measured_once_and_then_known(first_grid, measured, capsys):
    assert "measured 4, known before 0" in first_grid[1]
    assert "Plotly.newPlot(" in (measured / "surface.html").read_text()
    assert main(command(measured)) == 0
    assert "measured 0, known before 4" in capsys.readouterr().out


@pytest.mark.slow
def test_an_interrupted_grid_goes_on_where_it_stopped(measured, capsys):
    path = measured / "surface.csv"
    whole = path.read_text()
    path.write_text(whole[: -len(whole.splitlines()[-1]) // 2])  # the last line was cut off while written
    assert main(command(measured)) == 0
    assert "measured 1, known before 3" in capsys.readouterr().out
    kept, again = whole.splitlines(), path.read_text().splitlines()
    assert len(again) == 5
    assert again[:4] == kept[:4]


@pytest.mark.slow
def test_further_rounds_are_measured_beside_the_first_and_show_the_noise(measured, capsys):
    assert main(command(measured, "--rounds", "3")) == 0
    out = capsys.readouterr().out
    assert "measured 8, known before 4" in out
    assert "3 rounds: a single time varies by" in out
    rounds = [row.split(",")[6] for row in (measured / "surface.csv").read_text().splitlines()]
    assert rounds == ["round", *"111122223333"]


@pytest.mark.slow
def test_other_conditions_are_measured_anew_beside_the_known_ones(measured, capsys):
    assert main(command(measured, "--set", "integration_rate=1")) == 0
    assert main(command(measured, values=("0.1,0.2,0.3", "1e-5,1"))) == 0
    out = capsys.readouterr().out
    assert "measured 4, known before 0" in out
    assert "measured 2, known before 4" in out
    assert len((measured / "surface.csv").read_text().splitlines()) == 1 + 4 + 4 + 2


def test_a_point_that_cannot_run_is_a_failure_with_its_reason_and_the_rest_goes_on(tmp_path, capsys):
    arguments = ["surface", "--x", "compute_size_ratio", "--y", "mu", "--x-values", "7,8"]
    arguments += ["--y-values", "0.1,0.2", "--set", "volume_resolution=64", "--frames", "4"]
    assert main([*arguments, "--sequence", str(LIVING_ROOM), "--out", str(tmp_path)]) == 0
    assert capsys.readouterr().out.count("failed") == 4  # two points, in the tables of time and of error
    rows = (tmp_path / "surface.csv").read_text().splitlines()
    assert sum("ratio 7 must be a positive divisor of 640x480" in row for row in rows) == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--x", "mu", "--y", "mu"], "choose two parameters"),
        (["--x", "mu", "--y", "icp_weight"], "'icp_weight': kfusion has the parameters compute_size_ratio"),
        (["--x", "mu", "--y", "icp_threshold", "--x-values", "0.1"], "mu has 1 value"),
        (["--x", "mu", "--y", "icp_threshold", "--x-values", "0,0.1"], "mu=0.0: must be above 0"),
        (["--x", "mu", "--y", "icp_threshold", "--set", "nu=1"], "unknown parameter nu"),
    ],
)
def test_a_grid_that_makes_no_sense_is_refused_before_measuring(tmp_path, capsys, arguments, message):
    command = ["surface", *arguments, "--sequence", str(LIVING_ROOM), "--out", str(tmp_path)]
    assert main(command) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / "surface.csv").exists()


@pytest.mark.slow
def test_a_sequence_without_truth_has_no_error_surface(tmp_path, capsys):
    room = tmp_path / "room"
    made = ["datasets", "make", "living-room", "--frames", "1", "--size", "80x60", "--format", "tum"]
    assert main([*made, "--out", str(room)]) == 0
    (room / "groundtruth.txt").unlink()
    arguments = ["surface", "--x", "mu", "--y", "icp_threshold", "--out", str(tmp_path)]
    assert main([*arguments, "--sequence", str(room)]) == 2
    assert "no true trajectory" in capsys.readouterr().err


def test_a_file_of_something_else_is_not_overwritten(tmp_path, capsys):
    (tmp_path / "surface.csv").write_text("name,age\nAda,36\n")
    assert main(command(tmp_path)) == 2
    assert "has other columns" in capsys.readouterr().err
    assert (tmp_path / "surface.csv").read_text() == "name,age\nAda,36\n"


@pytest.mark.parametrize(
    ("system", "space"), [("kfusion", "kfusion-adaptive"), ("elasticfusion", "elasticfusion-ratio")]
)
def test_values_that_are_not_given_are_those_of_the_published_space(system, space):
    described = json.loads((SPACES / f"{space}.json").read_text())
    values = {p["name"]: tuple(p.get("values", (0, 1))) for p in described["parameters"]}
    optional = {p["name"] for p in described["parameters"] if "condition" in p}
    assert optional <= set(SYSTEMS[system].optional)
    assert {name: (0, *known) if name in optional else known for name, known in values.items()} == {
        name: known.values for name, known in SYSTEMS[system].parameters.items()
    }


def test_surfaces_have_the_plane_of_validity_holes_and_fitting_scales():
    grid = Grid("mu", "icp_threshold", (0.1, 0.2), (1e-5, 1.0))
    measured = {
        "runtime": np.array([[[0.010, 0.020], [np.nan, 0.012]]]),
        "ate_max": np.array([[[0.001, 0.5], [np.nan, 0.04]]]),
    }
    time, error = figures(grid, measured, "a <test>")
    assert time.data[0].z[0][1] == 20
    assert time.data[0].z[1][0] is None
    assert (time.layout.scene.xaxis.type, time.layout.scene.yaxis.type) == ("linear", "log")
    assert (time.layout.scene.zaxis.type, error.layout.scene.zaxis.type) == ("linear", "log")
    assert set(np.ravel(error.data[1].z)) == {0.05}
    assert "&lt;test&gt;" in time.layout.title.text
    assert table(grid, measured).count("failed") == 2


def test_a_grid_needs_two_different_values():
    with pytest.raises(SurfaceError, match="at least two"):
        Grid("mu", "icp_threshold", (0.1, 0.2), (1.0, 1.0))
