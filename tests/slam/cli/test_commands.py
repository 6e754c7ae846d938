import json

import numpy as np
import pytest

from slam.__main__ import main
from slam.datasets import open_sequence
from slam.datasets.formats.slambench import raw_file
from slam.trajectories.trajectory import Trajectory
from tests.shipped import LIVING_ROOM
from tests.slam.real import DATA, needs_real_data
from tests.slam.sequences import ArraySequence, random_poses
from tests.slam.tiny import write_tiny_pack

QUICK = ("--set", "compute_size_ratio=8", "--set", "volume_resolution=64")


def complaint(capsys, *arguments, code=2):
    """The one line on standard error of a command that fails."""
    assert main([str(argument) for argument in arguments]) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    return captured.err


def test_run_writes_report_and_trajectory_and_sums_up(tmp_path, capsys):
    report, poses = tmp_path / "report.json", tmp_path / "poses.txt"
    arguments = ["run", "--system", "kfusion", "--sequence", str(LIVING_ROOM), "--frames", "6", *QUICK]
    arguments += ["--set", "pyramid_iterations=4,2,0", "--json", str(report), "--trajectory", str(poses)]
    assert main(arguments) == 0
    data = json.loads(report.read_text())
    assert data["configuration"]["pyramid_iterations_fine"] == 4
    assert data["configuration"]["pyramid_iterations_coarse"] == 0
    assert len(Trajectory.read(poses)) == len(data["frames"]) == 6
    assert "6 frames of 640x480" in capsys.readouterr().out


def test_run_writes_log_mesh_and_pictures(tmp_path, capsys):
    files = [tmp_path / name for name in ("log.tsv", "room.ply", "views")]
    arguments = ["run", "--sequence", str(LIVING_ROOM), "--frames", "7", *QUICK]
    arguments += ["--tsv", str(files[0]), "--mesh", str(files[1])]
    assert main([*arguments, "--render", str(files[2]), "--render-every", "3"]) == 0
    assert len(files[0].read_text().splitlines()) == 8
    assert files[1].read_bytes().startswith(b"ply\nformat binary_little_endian 1.0\n")
    assert sorted(path.name for path in files[2].iterdir()) == ["000003.png", "000006.png"]
    out = capsys.readouterr().out
    assert "rendering" in out
    assert f"triangles in {files[1]}" in out


@pytest.mark.slow
def test_a_volume_that_a_device_refuses_is_one_line_and_leaves_no_files(tmp_path, capsys):
    arguments = ["run", "--sequence", LIVING_ROOM, "--set", "volume_resolution=8192"]
    assert "choose" in complaint(capsys, *arguments, "--tsv", tmp_path / "log.tsv")
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """The options for two tiny sequences."""
    folder = tmp_path_factory.mktemp("sequences")
    packs = [write_tiny_pack(folder, name=name) for name in ("tiny", "other")]
    return [word for pack in packs for word in ("--sequence", str(pack))]


@pytest.mark.slow
def test_run_measures_several_sequences_in_turn(pair, tmp_path, capsys):
    found = tmp_path / "report.json"
    assert main(["run", *pair, *QUICK, "--set", "compute_size_ratio=4", "--json", str(found)]) == 0

    names = [report["sequence"]["name"] for report in json.loads(found.read_text())["runs"]]
    assert names == ["tiny", "other"]
    first, second = capsys.readouterr().out.splitlines()
    assert first.startswith("tiny ")
    assert "ms a frame (95 %: " in second
    assert ", largest error " in second


@pytest.mark.slow
def test_a_configuration_as_json_ends_with_a_line_for_the_search(pair, capsys):
    configuration = {
        "system": "kfusion",
        "compute_size_ratio": 4,
        "volume_resolution": 64,
        "icp_weight": None,
    }
    assert main(["run", *pair[:2], "--set", json.dumps(configuration), "--objectives"]) == 0
    objectives = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert {"runtime", "ate_max"} <= objectives.keys()
    assert all(value >= 0 for value in objectives.values())


@pytest.mark.slow
def test_run_stops_after_the_sequences_that_fail(pair, capsys):
    arguments = ["run", *pair, *QUICK, "--set", "compute_size_ratio=4", "--stop-above", "ate_max=0"]
    assert main(arguments) == 0
    assert capsys.readouterr().out.splitlines()[1:] == [
        "1 not run: the largest error is above the limit of --stop-above"
    ]
    assert main([*arguments, "--stop-after", "2"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 2


@pytest.mark.slow
def test_run_perturbs_depth(pair, capsys):
    def ate(*more):
        quick = ["--set", "compute_size_ratio=4", "--set", "volume_resolution=64"]
        assert main(["run", *pair[:2], *quick, "--json", "-", *more]) == 0
        return json.loads(capsys.readouterr().out)["ate"]["max"]

    assert ate("--perturb", "1") == ate("--perturb", "1") != ate()


@pytest.mark.parametrize("option", ["--mesh", "--tsv", "--trajectory", "--render"])
def test_what_belongs_to_one_sequence_is_refused_for_several(option, pair, tmp_path, capsys):
    assert f"{option} needs exactly one sequence, got 2" in complaint(
        capsys, "run", *pair, option, tmp_path / "room.ply"
    )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--stop-after", "0"], "--stop-after 0: give 1 or more"),
        (["--perturb", "-1"], "perturbation -1: give a whole number of 0 or more"),
        (["--sequence", "nowhere"], "nowhere"),
    ],
)
def test_a_wrong_wish_for_several_sequences_is_one_line(more, message, pair, capsys):
    assert message in complaint(capsys, "run", *pair, *QUICK, *more)


def test_run_can_print_nothing_but_json(capsys):
    assert main(["run", "--sequence", str(LIVING_ROOM), "--frames", "2", *QUICK, "--json", "-"]) == 0
    assert len(json.loads(capsys.readouterr().out)["frames"]) == 2


def test_volume_and_start_of_the_command_line_go_before_the_sequences_own(tmp_path):
    poses = tmp_path / "poses.txt"
    arguments = ["run", "--sequence", str(LIVING_ROOM), "--frames", "1", *QUICK, "--trajectory", str(poses)]
    assert main([*arguments, "--volume-size", "4", "--initial-position", "0.25,0.5,0.1"]) == 0
    np.testing.assert_allclose(Trajectory.read(poses).poses[0, :3, 3], [1, 2, 0.4], atol=1e-6)


@pytest.mark.slow
def test_two_reports_are_compared(tmp_path, capsys):
    paths = [tmp_path / "first.json", tmp_path / "second.json"]
    for path, mu in zip(paths, ("0.1", "0.2"), strict=True):
        arguments = ["run", "--sequence", str(LIVING_ROOM), "--frames", "2", *QUICK, "--set", f"mu={mu}"]
        assert main([*arguments, "--json", str(path)]) == 0
    capsys.readouterr()
    assert main(["compare", *map(str, paths)]) == 0
    out = capsys.readouterr().out
    assert "mu: 0.1 | 0.2" in out
    assert "beware" not in out


def test_two_configurations_are_run_and_compared(capsys):
    settings = "compute_size_ratio=8 volume_resolution=64"
    arguments = ["--sequence", str(LIVING_ROOM), "--frames", "2"]
    assert main(["compare", settings, settings + " icp_threshold=1", *arguments]) == 0
    assert "icp_threshold: 1e-05 | 1" in capsys.readouterr().out


@pytest.mark.slow
def test_reports_and_configurations_are_compared_and_drawn_together(tmp_path, capsys):
    path, page = tmp_path / "first.json", tmp_path / "page.html"
    options = ["--sequence", str(LIVING_ROOM), "--frames", "2"]
    assert main(["run", *options, *QUICK, "--json", str(path)]) == 0
    settings = "compute_size_ratio=8 volume_resolution=64"
    assert main(["compare", str(path), settings, settings, *options, "--html", str(page)]) == 0
    out = capsys.readouterr().out
    assert f"C = {settings} again" in out
    assert "beware" not in out
    assert "Plotly.newPlot(" in page.read_text()


def test_evaluate_prints_the_error_as_json(tmp_path, capsys):
    poses = random_poses(20, np.random.default_rng(0))
    Trajectory(np.arange(20) / 30, poses).write(tmp_path / "truth.txt")
    poses[:, 0, 3] *= 2
    Trajectory(np.arange(20) / 30 + 0.001, poses).write(tmp_path / "estimate.txt")
    options = ["--estimate", str(tmp_path / "estimate.txt"), "--truth", str(tmp_path / "truth.txt")]
    errors = {}
    for align in ("first", "se3", "sim3"):
        assert main(["evaluate", *options, "--align", align]) == 0
        errors[align] = json.loads(capsys.readouterr().out)
        assert errors[align]["pairs"] == 20
    assert errors["first"]["rmse"] > errors["se3"]["rmse"] > errors["sim3"]["rmse"]
    assert errors["first"]["rmse_aligned"] == errors["se3"]["rmse"]


def test_evaluate_tells_every_alignment_and_the_drift(tmp_path, capsys):
    poses = random_poses(30, np.random.default_rng(1))
    Trajectory(np.arange(30) / 30, poses).write(tmp_path / "truth.txt")
    poses[:, :3, 3] *= 0.5
    Trajectory(np.arange(30) / 30, poses).write(tmp_path / "half.txt")
    options = ["--estimate", str(tmp_path / "half.txt"), "--truth", str(tmp_path / "truth.txt")]
    assert main(["evaluate", *options, "--align", "sim3", "--delta", "5"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["alignments"]["sim3"] == pytest.approx({"rmse": 0, "max": 0, "scale": 2}, abs=1e-6)
    assert result["alignments"]["se3"]["scale"] == 1
    assert result["rpe"]["delta"] == 5
    assert result["rpe"]["pairs"] == 25
    assert result["rpe"]["translation"]["max"] < 1e-6  # once the estimate is stretched, nothing drifts
    assert main(["evaluate", *options]) == 0
    assert json.loads(capsys.readouterr().out)["rpe"]["translation"]["rmse"] > 1e-3


@pytest.mark.slow
@needs_real_data
@pytest.mark.parametrize(
    ("recording", "align", "delta", "ate", "translation", "rotation"),
    [
        ("fr1_xyz", "first", 1, 0.01936791994170, 0.00576437084893, 0.35361316104480),
        ("fr1_xyz", "se3", 10, 0.01347008884973, 0.01404067599865, 0.67477774773311),
        ("fr1_xyz", "sim3", 1, 0.01338938490417, 0.00580569456312, 0.35361316104480),
        ("fr2_desk", "first", 10, 0.04201551171344, 0.00584179667388, 0.39590177022741),
        ("fr2_desk", "se3", 1, 0.00811897756205, 0.00349032137479, 0.28051922626733),
        ("fr2_desk", "sim3", 10, 0.00612316303016, 0.00584444742091, 0.39590177022741),
    ],
)
def test_errors_are_those_of_evo(capsys, recording, align, delta, ate, translation, rotation):
    """Of evo 1.38.1: APE of the translation; RPE over all pairs `delta` frames apart, after the alignment."""
    folder = DATA / "trajectories/tum"
    estimate, truth = {
        "fr1_xyz": ("freiburg1_xyz-rgbdslam.txt", "freiburg1_xyz-groundtruth.txt"),
        "fr2_desk": ("fr2_desk_ORB.txt", "fr2_desk_groundtruth.txt"),
    }[recording]
    files = ["--estimate", str(folder / estimate), "--truth", str(folder / truth)]
    assert main(["evaluate", *files, "--align", align, "--delta", str(delta)]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["rmse"] == pytest.approx(ate, rel=1e-9)
    assert result["rpe"]["translation"]["rmse"] == pytest.approx(translation, rel=1e-9)
    assert result["rpe"]["rotation_degrees"]["rmse"] == pytest.approx(rotation, rel=1e-9)


@pytest.mark.slow
@needs_real_data
def test_a_real_recording_is_tracked_frame_by_frame(capsys):
    arguments = ["run", "--sequence", str(DATA / "rgbd/redkitchen"), "--frames", "25", "--volume-size", "6"]
    arguments += ["--initial-position", ".5,.5,.1", "--set", "compute_size_ratio=4", "--json", "-"]
    assert main(arguments) == 0
    report = json.loads(capsys.readouterr().out)
    assert [frame["tracked"] for frame in report["frames"]] == [None] * 4 + [True] * 21
    assert report["ate"]["max"] < 0.05


@pytest.mark.slow
def test_sequences_are_converted_and_described(tmp_path, capsys):
    raw, again = tmp_path / "scene.raw", tmp_path / "again"
    made = ["datasets", "make", "living-room", "--frames", "1", "--size", "160x120"]
    assert main([*made, "--out", str(tmp_path / "room")]) == 0
    assert main(["datasets", "convert", str(tmp_path / "room"), str(raw)]) == 0
    camera = ["--camera", "120.3,120,79.5,59.5"]
    options = ["--volume-size", "6", "--initial-position", "0.5,0.5,0.1"]
    assert main(["datasets", "convert", str(raw), str(again), *camera, *options]) == 0
    packed = open_sequence(again)
    assert packed.volume_size == 6
    np.testing.assert_array_equal(packed.depth(0), open_sequence(tmp_path / "room").depth(0))
    capsys.readouterr()
    assert main(["datasets", "info", str(again)]) == 0
    assert "6 m" in capsys.readouterr().out
    assert main(["datasets", "list", str(tmp_path)]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == ["again", "room"]


def test_the_shipped_sequence_is_listed(capsys):
    assert main(["datasets", "list"]) == 0
    assert "living-room " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "--sequence", "nowhere"], "nowhere does not exist"),
        (["run", "--sequence", LIVING_ROOM, "--set", "nu=1"], "unknown parameter nu"),
        (["run", "--sequence", LIVING_ROOM, "--set", "mu=0"], "mu=0.0"),
        (["run", "--sequence", LIVING_ROOM, "--frames", "999"], "frames=999"),
        (["run", "--sequence", LIVING_ROOM, "--json", "no/folder/x.json"], "there is no folder no/folder"),
        (["run", "--sequence", LIVING_ROOM, "--tsv", "no/folder/x.tsv"], "there is no folder no/folder"),
        (["run", "--sequence", LIVING_ROOM, "--mesh", "no/folder/x.ply"], "there is no folder no/folder"),
        (["run", "--sequence", LIVING_ROOM, "--trajectory", LIVING_ROOM], "it is a folder"),
        (["run", "--sequence", LIVING_ROOM, "--render-every", "0"], "--render-every 0"),
        (["run", "--sequence", "nowhere", "--set", "tracking_rate=0"], "tracking_rate=0: must be at least 1"),
        (["run", "--set", '{"system": "elasticfusion"}'], "give --system elasticfusion, not kfusion"),
        (["compare", "", "mu=-1", "--sequence", LIVING_ROOM], "mu=-1.0"),
        (["compare", "a.json", "b.json", "--html", "no/folder/x.html"], "there is no folder no/folder"),
        (["compare", "nowhere.json"], "nowhere.json"),
        (["run", "--sequence", LIVING_ROOM, "--camera", "1,2,3,4"], "contains its camera"),
        (["run", "--sequence", LIVING_ROOM, "--volume-size", "0"], "--volume-size 0: give metres"),
        (["run", "--system", "elasticfusion", "--sequence", LIVING_ROOM, "--volume-size", "-1"], "than 0"),
        (["run", "--system", "elasticfusion", "--frames", "0"], "the frames of 'living-room'"),
        (["compare", "mu=x", "mu=2", "--sequence", LIVING_ROOM], "'x' is not a number"),
        (["evaluate", "--estimate", "none", "--truth", "none"], "none cannot be read"),
        (["datasets", "info", "nowhere"], "nowhere does not exist"),
        (["datasets", "make", "living-room", "--frames", "0", "--out", "x"], "at least one frame"),
    ],
)
def test_a_mistake_is_answered_with_one_line(capsys, arguments, message):
    assert message in complaint(capsys, *arguments)


def test_a_device_that_is_not_here_has_an_exit_code_of_its_own(capsys):
    arguments = ("run", "--sequence", LIVING_ROOM, "--device", "abacus")
    assert "no OpenCL device matches 'abacus'" in complaint(capsys, *arguments, code=3)


def test_trajectories_of_different_times_are_refused(tmp_path, capsys):
    poses = random_poses(3, np.random.default_rng(0))
    Trajectory(np.arange(3.0), poses).write(tmp_path / "a.txt")
    Trajectory(np.arange(3.0) + 1e9, poses).write(tmp_path / "b.txt")
    error = complaint(capsys, "evaluate", "--estimate", tmp_path / "a.txt", "--truth", tmp_path / "b.txt")
    assert "lie within 0.01 s" in error


def test_a_report_that_is_none_is_refused(tmp_path, capsys):
    (tmp_path / "bad.json").write_text('{"frames": []}')
    assert "is not a report" in complaint(capsys, "compare", tmp_path / "bad.json", tmp_path / "bad.json")


@pytest.mark.parametrize(
    "bad",
    [["--set", "mu"], ["--set", '{"mu": '], ["--set", "pyramid_iterations=1,2"], ["--volume-size", "nan"]],
)
def test_arguments_that_say_nothing_are_refused(capsys, bad):
    with pytest.raises(SystemExit) as exit:
        main(["run", "--sequence", str(LIVING_ROOM), *bad])
    assert exit.value.code == 2
    assert bad[1] in capsys.readouterr().err


@pytest.mark.parametrize("size", ["213x160", "640x240", "0x0", "large"])
def test_a_size_that_pixels_do_not_add_up_to_is_refused_with_those_that_do(capsys, tmp_path, size):
    with pytest.raises(SystemExit) as exit:
        main(["datasets", "make", "living-room", "--out", str(tmp_path / "room"), "--size", size])
    assert exit.value.code == 2
    assert f"{size!r} is not one of 640x480, 320x240, 160x120," in capsys.readouterr().err


@pytest.mark.parametrize("size", ["128x96", "4x3"])
def test_sizes_that_an_error_names_can_be_made(capsys, tmp_path, size):
    out = str(tmp_path / "room")
    assert main(["datasets", "make", "living-room", "--frames", "1", "--out", out, "--size", size]) == 0
    camera = open_sequence(tmp_path / "room").camera
    assert f"{camera.width}x{camera.height}" == size


def test_elasticfusion_has_no_webgpu_backend(capsys):
    arguments = ["run", "--system", "elasticfusion", "--backend", "webgpu", "--sequence", str(LIVING_ROOM)]

    assert main(arguments) == 2
    assert capsys.readouterr().err == ("frontrunner: backend webgpu: elasticfusion runs on opencl only\n")


@pytest.mark.slow
def test_run_warns_of_a_truth_whose_name_says_the_wrong_axes(tmp_path, capsys):
    living_room = open_sequence(LIVING_ROOM)
    depth = [living_room.depth(frame)[::4, ::4] for frame in range(30)]
    raw_file.write(ArraySequence(depth), tmp_path / "room.raw")
    Trajectory(np.arange(30) / 30, living_room.truth[:30]).write(tmp_path / "truth.freiburg")
    command = ["run", "--sequence", str(tmp_path / "room.raw"), "--camera", "120.3,120,79.5,59.5"]
    command += ["--truth", str(tmp_path / "truth.freiburg"), "--volume-size", "4.8", *QUICK[2:]]
    command += ["--initial-position", "0.5,0.48,0.1"]
    assert main(command) == 0
    assert "if y of the truth is mirrored: give --truth-axes opencv" in capsys.readouterr().err
    assert main([*command, "--truth-axes", "opencv"]) == 0
    assert "warning" not in capsys.readouterr().err
