import copy
import sys

import pytest

from slam.benchmark import run
from slam.datasets import open_sequence
from slam.reports.compare import figures
from slam.reports.page import MissingPlotlyError, save
from tests.shipped import LIVING_ROOM


@pytest.fixture(scope="module")
def report():
    quick = {"compute_size_ratio": 8, "volume_resolution": 64}
    return run(quick, open_sequence(LIVING_ROOM), frames=11).to_dict()


def test_stages_are_stacked_and_frames_drawn_one_by_one(report):
    stages, computation, _, error = figures({"a": report, "b": report})
    assert [bar.name for bar in stages.data] == ["preprocessing", "tracking", "integration", "raycasting"]
    drawn = sum(bar.x[1] for bar in stages.data)
    counted = report["frames"][10:]
    known = [sum(frame[bar.name] for bar in stages.data) for frame in counted]
    assert drawn == pytest.approx(1e3 * sum(known) / len(counted))
    assert [line.name for line in computation.data] == ["a", "b"]
    assert len(computation.data[0].y) == 11
    assert max(error.data[0].y) == pytest.approx(report["ate"]["max"])


def test_the_systems_are_named(report):
    other = copy.deepcopy(report) | {"system": "elasticfusion"}
    stages, *_ = figures({"a": report, "b": other})
    assert stages.layout.title.text.startswith("Time per stage of elasticfusion and kfusion on ")


def test_lost_frames_are_marked_where_they_happened(report):
    lost = copy.deepcopy(report)
    lost["frames"][7]["tracked"] = False
    *_, error = figures({"good": report, "bad": lost})
    marks = next(trace for trace in error.data if trace.name == "bad: lost")
    assert list(marks.x) == [7]


def test_integrated_skipped_and_lost_frames_are_drawn_over_time(report):
    adapted = copy.deepcopy(report)
    for frame in adapted["frames"]:
        frame["integrated"] = False
    adapted["frames"][2]["integrated"] = True
    adapted["frames"][5]["skipped"] = adapted["frames"][6]["skipped"] = True
    adapted["frames"][7]["tracked"] = False
    _, _, frames, _ = figures({"old": report, "new": adapted})
    drawn = {trace.name: list(trace.x) for trace in frames.data}
    assert drawn["new: integrated (1)"] == [2]
    assert drawn["new: skipped (2)"] == [5, 6]
    assert drawn["new: lost (1)"] == [7]
    assert drawn["old: skipped (0)"] == [None]


def test_without_truth_there_is_no_figure_of_errors(report):
    blind = copy.deepcopy(report)
    for frame in blind["frames"]:
        frame["error"] = None
    assert len(figures({"blind": blind})) == 3


def test_names_are_shown_literally(report):
    stages, *_ = figures({"<b>&": report})
    assert stages.data[0].y[0] == "&lt;b&gt;&amp;"


def test_a_page_needs_no_network(report, tmp_path):
    drawn = figures({"a": report})
    save(tmp_path / "page.html", "A & B", drawn)
    text = (tmp_path / "page.html").read_text()
    assert text.startswith("<!doctype html>")
    assert "<title>A &amp; B</title>" in text
    assert "<script src=" not in text
    assert text.count("Plotly.newPlot(") >= len(drawn)


def test_without_plotly_one_line_says_what_to_install(report, monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "plotly"] or ["plotly"]:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingPlotlyError, match="pip install plotly"):
        figures({"a": report})
