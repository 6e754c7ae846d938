"""`python -m slam` with ElasticFusion."""

from __future__ import annotations

import json

import numpy as np
import pytest

from slam.__main__ import main
from slam.datasets.formats.images import read_colour
from slam.reports.render import BACKGROUND
from slam.trajectories.trajectory import Trajectory
from tests.slam.tiny import write_tiny_pack

SMALL = ["--system", "elasticfusion", "--set", "surfel_capacity=200000"]


@pytest.fixture
def sequence(tmp_path):
    return write_tiny_pack(tmp_path, colour=True)


@pytest.mark.slow
def test_a_run_writes_report_trajectory_surfels_and_coloured_pictures(sequence, tmp_path, capsys):
    outputs = ["--json", tmp_path / "r.json", "--trajectory", tmp_path / "t.txt"]
    outputs += ["--mesh", tmp_path / "m.ply", "--render", tmp_path / "views"]
    command = ["run", *SMALL, "--sequence", sequence, "--set", "confidence_threshold=1", *outputs]
    assert main([str(argument) for argument in command]) == 0
    report = json.loads((tmp_path / "r.json").read_text())
    assert report["system"] == "elasticfusion"
    assert report["configuration"]["confidence_threshold"] == 1
    assert [frame["tracked"] for frame in report["frames"]] == [None] + [True] * 11
    assert report["ate"]["max"] < 0.02
    assert report["ate_online"] == pytest.approx(report["ate"])  # no loop is closed in a moment
    assert report["loops"] == {"local": 0, "global": 0, "relocalisations": 0}
    assert len(Trajectory.read(tmp_path / "t.txt")) == 12
    header = (tmp_path / "m.ply").read_bytes().split(b"end_header")[0].decode()
    assert "property float radius" in header
    assert int(header.split("element vertex ")[1].split()[0]) > 1000
    picture = read_colour(tmp_path / "views" / "000010.png")
    coloured = picture[(picture != BACKGROUND).any(axis=2)].astype(int)
    assert np.abs(coloured[:, 0] - coloured[:, 2]).max() > 60
    out = capsys.readouterr().out
    assert "closing loops, fusing the frame into the map" in out
    assert "stable surfels in" in out
    assert "loops         closed 0 local, 0 global; relocalisations 0\n" in out


def test_a_sequence_without_colour_is_refused_with_where_colour_would_lie(tmp_path, capsys):
    assert main(["run", *SMALL, "--sequence", str(write_tiny_pack(tmp_path))]) == 2
    assert "'tiny' has no colour, which elasticfusion needs" in capsys.readouterr().err
