"""Programs that end early: the marks of bounds in files, and what other commands make of them."""

import json

from pareto import Explorer, Space
from pareto.cli.commands import main
from pareto.measuring.folder import Folder
from pareto.measuring.measurements import read_measurements
from tests.pareto.conftest import SPACE, explore, explored_rows, rows

# The error of x is x: half of it is certain at once, and the rest only after a while.
REPORTS = """
echo "report error=$(($1 / 2)) seconds~$1"
if [ $1 -gt 8 ]; then sleep 60; fi
echo '{"error": '$1', "seconds": '$1'}'
"""
MARKED = "x,mode,error,seconds,censored\n1,c,1,9,\n2,c,0.5,8,error\n3,c,3,7,\n"


def stopped(toy, *more):
    """The rows of a search for 12 measurements, four at a time unless `more` options say otherwise."""
    (toy / "program.sh").write_text(REPORTS)
    source = ["--command", f"sh {toy}/program.sh {{x}}"]
    options = ["--budget", "12", "--limits", "error=4", "--jobs", "4", "--grace", "0.2"]
    assert explore(toy, *options, *more, source=source) == 0
    return rows(toy / "out" / "evaluations.csv")


def test_what_ended_early_is_a_bound_in_the_file_in_the_state_and_after_a_resumption(toy, capsys):
    evaluations = stopped(toy)
    beyond = [row for row in evaluations if int(row["x"]) > 9]
    assert beyond
    assert {row["censored"] for row in beyond} == {"error"}
    assert all(float(row["error"]) == int(row["x"]) // 2 for row in beyond)
    assert all(float(row["seconds"]) == int(row["x"]) for row in beyond)
    assert {row["censored"] for row in evaluations if row not in beyond} == {""}
    assert f"{len(beyond)} ended early" in capsys.readouterr().err
    space = Space.from_dict(SPACE)
    kept = Folder(toy / "out").read(space)
    (toy / "out" / "state.json").unlink()
    rebuilt = Folder(toy / "out").rebuild(Explorer(space, ["error", "seconds"], {"error": 4}), "lost")
    for explorer in (kept, rebuilt):
        assert sum(~explorer.history.exact()) == len(beyond)


def test_a_configuration_that_ended_early_is_not_repeated(toy):
    evaluations = stopped(toy, "--repeats", "2", "--jobs", "1")
    ended = [(row["x"], row["mode"]) for row in evaluations if row["censored"]]
    assert len(ended) == len(set(ended)) > 0


def test_marks_stay_in_a_table_a_warm_start_and_a_prior(toy):
    (toy / "marked.csv").write_text(MARKED)
    table = ["--table", str(toy / "marked.csv")]
    assert explore(toy, "--budget", "40", source=table, out="table") == 0
    [bound] = [row for row in rows(toy / "table" / "evaluations.csv") if row["censored"] == "error"]
    assert bound["x"] == "2"
    again = ["--warm-start", str(toy / "marked.csv"), "--budget", "1"]
    assert [row["censored"] for row in explored_rows(toy, *again)] == ["", "error", "", ""]
    assert "2" not in {row["x"] for row in rows(toy / "out" / "front.csv")}
    learning = ["--method", "bayesian", "--prior", str(toy / "marked.csv"), "--budget", "1"]
    assert explore(toy, *learning, out="p") == 0
    prior = json.loads((toy / "p" / "state.json").read_text())["prior"]
    assert [values for _, _, [values] in prior] == [[1, 9], [{"censored": 0.5}, 8], [3, 7]]


def test_fronts_and_comparisons_leave_bounds_out(toy, capsys):
    (toy / "marked.csv").write_text(MARKED)
    marked, space = str(toy / "marked.csv"), ["--space", str(toy / "space.json")]
    for more in ([], space):
        assert main(["front", marked, "--objectives", "error,seconds", *more]) == 0
        assert {line.split(",")[0] for line in capsys.readouterr().out.splitlines()[1:]} == {"1", "3"}
    assert main(["compare", marked, marked, *space, "--objectives", "error", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["common"] == 2
    assert main(["transfer", marked, *space, "--objectives", "error,seconds"]) == 0
    assert {line.split(",")[0] for line in capsys.readouterr().out.splitlines()[1:]} == {"1", "3"}


def test_a_mark_may_name_a_column_that_is_no_objective_here_but_nothing_unknown(toy, capsys):
    (toy / "marked.csv").write_text(MARKED)
    [_, second, _] = read_measurements(
        toy / "marked.csv", Space.from_dict(SPACE), Explorer(Space.from_dict(SPACE), ["seconds"]).objectives
    )
    assert second[1] == {"seconds": 8.0}
    (toy / "marked.csv").write_text(MARKED.replace(",error\n", ",errors\n"))
    assert explore(toy, "--budget", "1", "--warm-start", str(toy / "marked.csv")) == 2
    assert "marked.csv, line 3: censored is 'errors'" in capsys.readouterr().err
