"""`slam run --front`: the point that is picked before the run, and what is said where none fits."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from slam.__main__ import main
from slam.cli.arguments import UsageError
from slam.cli.front_point import pick, read
from tests.shipped import LIVING_ROOM

POINTS = {"default": (0.020, 0.004), "best": (0.003, 0.040), "knee": (0.005, 0.012), "fast": (0.002, 0.049)}
QUICK = {"compute_size_ratio": 8, "volume_resolution": 64}


@pytest.fixture
def front(tmp_path: Path) -> Path:
    path = tmp_path / "kfusion-9.json"
    write(path)
    return path


def write(path: Path, **changes: Any) -> None:
    configurations: list[dict[str, Any]] = [
        {"name": name, "parameters": QUICK, "predicted": {"runtime": runtime, "ate_max": error}}
        for name, (runtime, error) in POINTS.items()
    ]
    lost = {"name": "lost", "parameters": QUICK, "predicted": {"runtime": 0.001, "ate_max": None}}
    provenance = {"device": "Bench CPU"}
    document = {
        "application": "kfusion",
        "configurations": [*configurations, lost],
        "provenance": provenance,
    }
    path.write_text(json.dumps(document | changes))


@pytest.mark.parametrize(
    ("max_ms", "max_ate", "name", "reason"),
    [
        (None, None, "best", "no limit is given, so the front's best point"),
        (5, None, "knee", "the most accurate of 3 points within 5 ms a frame"),
        (4, None, "best", "the most accurate of 2 points within 4 ms a frame"),
        (100, 0.02, "default", "the most accurate of 2 points within 100 ms a frame and 2 cm"),
        (None, 0.02, "knee", "the fastest of 2 points within 2 cm"),
    ],
)
def test_the_point_and_the_reason_follow_from_the_limits(
    front: Path, max_ms: float | None, max_ate: float | None, name: str, reason: str
) -> None:
    point, said = pick(read(front).points, max_ms, max_ate)
    assert (point.name, said) == (name, reason)


@pytest.mark.parametrize(
    ("max_ms", "max_ate", "message"),
    [
        (1, None, r"at most 1 ms a frame: the nearest is fast \(2 ms a frame, 4\.9 cm\)"),
        (4, 0.01, r"within 4 ms a frame has an error of at most 1 cm: the nearest is best \(3 ms"),
        (None, 0.001, r"no point has an error of at most 0\.1 cm: the nearest is default"),
    ],
)
def test_where_no_point_fits_the_nearest_is_named(
    front: Path, max_ms: float | None, max_ate: float | None, message: str
) -> None:
    with pytest.raises(UsageError, match=message):
        pick(read(front).points, max_ms, max_ate)


def test_the_point_is_named_with_its_reason_and_then_run(
    front: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report = tmp_path / "report.json"
    command = ["run", "--sequence", str(LIVING_ROOM), "--frames", "2", "--front", str(front)]
    assert main([*command, "--max-ms", "5", "--json", str(report)]) == 0
    said = next(line for line in capsys.readouterr().err.splitlines() if "running" in line)
    assert said == (
        "frontrunner: running knee (5 ms a frame, 1.2 cm): the most accurate of 3 points within 5 ms a "
        "frame; predicted for Bench CPU"
    )
    assert json.loads(report.read_text())["configuration"].items() >= QUICK.items()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--max-ms", "5"], "give --front FILE"),
        (["--front", "FRONT", "--set", "mu=0.2"], "--front and --set: give one of them"),
        (["--front", "FRONT", "--system", "elasticfusion"], "is a front of kfusion: add --system kfusion"),
        (["--front", "pareto/spaces/kfusion.json"], "is not the file of a front: it lacks 'configurations'"),
        (["--front", "README.md"], "README.md is not the file of a front: Expecting value"),
        (["--front", "nowhere.json"], "nowhere.json"),
    ],
)
def test_what_cannot_be_picked_is_one_line(
    front: Path, options: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", *(str(front) if word == "FRONT" else word for word in options)]) == 2
    captured = capsys.readouterr()
    assert (captured.out, captured.err.count("\n")) == ("", 1)
    assert message in captured.err


def test_the_error_is_the_largest_of_all_sequences_also_of_those_that_were_held_out(front: Path) -> None:
    document = json.loads(front.read_text())
    knee = next(point for point in document["configurations"] if point["name"] == "knee")
    knee["learned_on"] = [{"sequence": "office", "ate_max": 0.013, "lost": 0}]
    knee["held_out"] = [{"sequence": "library", "ate_max": 0.061, "lost": 0}]
    front.write_text(json.dumps(document))

    picked, _ = pick(read(front).points, None, 0.02)

    assert picked.name == "default"
    with pytest.raises(UsageError, match=r"nearest is knee \(5 ms a frame, 6\.1 cm on library\)"):
        pick([point for point in read(front).points if point.name == "knee"], None, 0.02)


def test_a_front_on_which_every_point_lost_the_camera_is_refused(front: Path) -> None:
    write(front, configurations=[])
    with pytest.raises(UsageError, match="no point with a predicted error"):
        read(front)


def test_every_shipped_front_is_read() -> None:
    fronts = sorted((Path(__file__).parents[3] / "fixtures" / "fronts").glob("*.json"))
    assert fronts
    for path in fronts:
        assert {"default", "best"} <= {point.name for point in read(path).points}
