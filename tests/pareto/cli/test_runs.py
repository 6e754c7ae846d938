"""One page over many explorations."""

import re

import pytest

from pareto.cli.commands import main
from pareto.fronts.hypervolume import hypervolume
from tests.pareto.conftest import explore, rows


@pytest.fixture
def cells(toy, capsys):
    """A function that draws the page of folders and returns its rows as lists of texts."""

    def read(*folders):
        assert main(["runs", *map(str, folders), "--output", str(toy / "pages" / "runs.html")]) == 0
        page = (toy / "pages" / "runs.html").read_text()
        lines = re.findall(r"<tr>(<td>.*?)</tr>", page)
        return [re.findall(r"<td>(.*?)</td>", line) for line in lines]

    (toy / "pages").mkdir()
    return read


def test_each_folder_is_a_row_and_equal_problems_have_one_reference(toy, cells):
    explore(toy, "--budget", "30", "--seed", "1", out="many/a & b")
    explore(toy, "--budget", "12", "--seed", "2", out="many/short")
    explore(toy, "--budget", "12", "--limits", "error=0.5", out="other")
    (toy / "many" / "a & b" / "front.html").touch()
    first, second, other = cells(toy / "many", toy / "other")
    assert first[0].startswith('<a href="../many/a%20%26%20b/front.html">')
    assert "a &amp; b" in first[0]
    assert (second[0], other[0]) == (str(toy / "many" / "short"), str(toy / "other"))
    assert (first[1], other[1]) == ("toy: error, seconds", "toy: error at most 0.5, seconds")
    assert [row[2] for row in (first, second, other)] == ["30", "12", "12"]
    assert [row[3] for row in (first, second, other)] == ["30", "12", "12"]
    worst, fronts = [0.0, 0.0], []
    for out in ("a & b", "short"):
        measured = [row for row in rows(toy / "many" / out / "evaluations.csv") if not row["failure"]]
        values = [[float(row["error"]), float(row["seconds"])] for row in measured]
        worst = [max(worst[column], *(row[column] for row in values[:10])) for column in (0, 1)]
        fronts.append(values)
    volumes = [hypervolume(values, worst, log=True) for values in fronts]
    best = max(volumes)
    texts = [f"<b>{volume:.4g}</b>" if volume == best else f"{volume:.4g}" for volume in volumes]
    assert [first[6], second[6]] == texts
    assert "<b>" not in other[6]  # the only run of its problem
    assert re.fullmatch(r"\d{4}-\d\d-\d\d \d\d:\d\d", first[7])


def test_a_larger_budget_is_the_planned_one(toy, cells):
    explore(toy, "--budget", "5")
    explore(toy, "--budget", "8")
    [[_, _, measured, budget, *_]] = cells(toy / "out")
    assert (measured, budget) == ("8", "8")
    (toy / "out" / "plan.json").unlink()
    [[_, _, _, budget, *_]] = cells(toy / "out")
    assert budget == "unknown"


def test_a_folder_that_cannot_be_read_is_left_out_with_a_warning(toy, cells, capsys):
    explore(toy, "--budget", "5", out="good")
    explore(toy, "--budget", "5", out="bad")
    (toy / "bad" / "state.json").write_text("{")
    assert [row[0] for row in cells(toy)] == [str(toy / "good")]
    assert f"{toy / 'bad'} is left out" in capsys.readouterr().err
    for folder, message in ((toy / "none", "is not a folder"), (toy / "pages", "no exploration")):
        assert main(["runs", str(folder)]) == 2
        assert message in capsys.readouterr().err
