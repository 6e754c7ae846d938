import copy
import json

import numpy as np
import pytest

from slam.benchmark import run
from slam.datasets import open_sequence
from slam.definitions import SYSTEMS
from slam.reports.report import MEANINGS, ReportError, comparison, line, milliseconds, read, summary
from slam.reports.slambench_log import COLUMNS, log
from tests.shipped import LIVING_ROOM

QUICK = {"compute_size_ratio": 8, "volume_resolution": 64}


@pytest.fixture(scope="module")
def measured():
    return run(QUICK, open_sequence(LIVING_ROOM), frames=12)


@pytest.fixture
def report(measured):
    return copy.deepcopy(measured.to_dict())


def test_a_summary_explains_every_line_of_its_table(report):
    text = summary(report)
    table, explanations = text.split("\n\n")[1], text.split("\n\n")[3]
    for row in table.splitlines()[1:]:
        name = row.split()[0]
        assert f"{name}: {(SYSTEMS['kfusion'].stages | MEANINGS)[name]}" in explanations
    for column in ("mean", "95%", "share"):
        assert column in table.splitlines()[0]
        assert column in explanations
    assert "milliseconds a frame, over the frames from 10 on" in explanations
    assert "stages by the device's clock" in explanations


def test_times_of_a_summary_are_those_of_the_frames_that_count(report):
    for number, frame in enumerate(report["frames"]):
        frame["tracking"] = 0.5 if number < 10 else 0.001 * (number - 9)
    assert milliseconds(report, "tracking").tolist() == pytest.approx([1, 2])
    row = next(row for row in summary(report).splitlines() if row.startswith("tracking"))
    assert row.split()[1:5] == ["1.500", "1.500", "1.950", "2.000"]


def test_what_is_not_known_is_said_to_be_unknown_and_never_zero(report):
    report |= {"ate": None, "valid": None, "peak_memory_bytes": None, "energy_joules": None}
    text = summary(report)
    for name in ("memory", "energy", "error"):
        assert next(row for row in text.splitlines() if row.startswith(name)).split()[1].startswith("unkn")


def test_skipped_frames_are_counted_apart_from_those_not_attempted(report):
    assert "skipped" not in summary(report)
    for frame in report["frames"][6:9]:
        frame |= {"tracked": None, "skipped": True}
    text = summary(report)
    assert "frames        tracked 5, lost 0, skipped 3 (25 %), not attempted 4; integrated" in text
    assert "skipped: not computed" in text
    assert line(report).endswith(", 0 lost, 25 % skipped")
    skipped = next(row for row in comparison({"a": report}).splitlines() if row.startswith("skipped"))
    assert skipped.split() == ["skipped", "25", "%"]


def test_every_time_says_its_mean_its_95th_percentile_and_its_largest(report):
    for number, frame in enumerate(report["frames"]):
        frame["computation"] = 0.001 * max(number - 9, 1)
    assert " 1.500 ms a frame (95 %: 1.950, max 2.000), " in line(report)
    rows = dict(row.split(maxsplit=1) for row in comparison({"a": report}).splitlines() if row.split()[1:])
    assert (rows["computation"], rows["95%"], rows["max"]) == ("1.500 ms", "1.950 ms", "2.000 ms")


def test_loops_have_a_line_where_a_system_closes_any(report):
    assert "loops" not in report
    assert "loops" not in summary(report)
    report["loops"] = {"local": 2, "global": 1, "relocalisations": 3}
    text = summary(report)
    assert "loops         closed 2 local, 1 global; relocalisations 3\n" in text
    assert "loops: local, by registering" in text


def test_energy_is_reported_with_its_source(report):
    computed = sum(frame["computation"] for frame in report["frames"])
    report |= {"energy_joules": 12 * computed, "energy_source": "ina"}
    assert "12.00 W: the board's rails" in summary(report)


def test_pictures_have_a_line_only_when_they_were_drawn(report):
    assert "rendering" not in summary(report)
    for frame in report["frames"]:
        frame["rendering"] = 0.004
    assert "rendering          4.000" in summary(report)


def test_a_report_is_read_back_as_it_was_written(report, tmp_path):
    (tmp_path / "report.json").write_text(json.dumps(report))
    assert read(tmp_path / "report.json") == report


@pytest.mark.parametrize("text", ["", "[]", "{}", "7", '{"frames": []}', "\x00"])
def test_what_is_no_report_is_refused_by_name(text, tmp_path):
    (tmp_path / "other.json").write_text(text)
    with pytest.raises(ReportError, match=r"other\.json is not a report"):
        read(tmp_path / "other.json")


def test_a_report_without_rendering_is_still_read(report, tmp_path):
    for frame in report["frames"]:
        del frame["rendering"], frame["error"]
    (tmp_path / "old.json").write_text(json.dumps(report))
    assert "raycasting" in summary(read(tmp_path / "old.json"))


def test_a_comparison_names_speedup_differences_and_doubts(report):
    other = copy.deepcopy(report)
    for frame in other["frames"]:
        frame["computation"] *= 0.25
    other["configuration"]["mu"] = 0.2
    text = comparison({"slow": report, "fast": other})
    assert "A = slow\nB = fast\n" in text
    assert next(row for row in text.splitlines() if row.startswith("speedup")).split()[1:] == [
        "1.00",
        "4.00",
    ]
    assert "mu: 0.1 | 0.2" in text
    assert "beware" not in text
    other["sequence"]["sha256"] = "0" * 64
    other["device"]["name"] = "another"
    del other["frames"][-1]
    assert comparison({"slow": report, "fast": other}).count("beware") == 3


def test_a_comparison_names_the_system_of_each_column_and_says_where_they_differ(report):
    def systems(text):
        return next(row for row in text.splitlines() if row.startswith("system")).split()[1:]

    other = copy.deepcopy(report) | {"system": "elasticfusion"}
    text = comparison({"one": report, "other": other})
    assert systems(text) == ["kfusion", "elasticfusion"]
    assert "beware: they ran different systems" in text
    assert text.count("beware") == 1
    text = comparison({"one": other, "again": other})
    assert systems(text) == ["elasticfusion", "elasticfusion"]
    assert "beware" not in text


def test_the_log_has_slambenchs_columns_and_the_reports_numbers(measured):
    lines = [line.split("\t") for line in log(measured).splitlines()]
    assert lines[0] == list(COLUMNS)
    assert COLUMNS == (
        "frame", "acquisition", "preprocessing", "tracking", "integration", "raycasting", "rendering",
        "computation", "total", "X", "Y", "Z", "tracked", "integrated",
    )  # fmt: skip
    assert len(lines) == 13
    rows = np.array(lines[1:], np.float64)
    assert rows[:, 0].tolist() == list(range(12))
    np.testing.assert_allclose(rows[:, 7], [frame.computation for frame in measured.frames], atol=1e-9)
    assert (rows[:, 2:6].sum(axis=1) <= rows[:, 7]).all()
    np.testing.assert_allclose(rows[:, 9:12], measured.poses[:, :3, 3] - measured.poses[0, :3, 3], atol=1e-8)
    assert rows[:, 12].tolist() == [0] * 4 + [1] * 8
    assert set(rows[:, 13]) <= {0, 1}
