"""python -m pareto compare and transfer, and explore --prior."""

import csv
import io
import json

import pytest

from pareto import Objective, Space
from pareto.cli.commands import main
from pareto.devices.correlation import correlate
from pareto.errors import ScenarioError
from pareto.measuring.measurements import read_measurements
from tests.pareto.conftest import SCENARIO, SPACE, complaint, explore, rows


def compare(toy, *more, tables=("table.csv", "other.csv")):
    return main(["compare", *(str(toy / name) for name in tables), "--space", str(toy / "space.json"), *more])


@pytest.fixture
def devices(toy):
    """A second device on which every third configuration failed and the order is nearly the same."""
    lines = ["x,mode,error,seconds"]
    for x in range(1, 21):
        seconds = "failed" if x % 3 == 0 else str(2.5 * x + (x % 2) * 4)
        lines.append(f'{x},"a,b",{1 / x},{seconds}')
    (toy / "other.csv").write_text("\n".join(lines) + "\n")
    return toy


def test_compare_prints_correlations_and_ranks_of_the_best(devices, capsys):
    assert compare(devices, "--objectives", "seconds", "--json") == 0
    [answer] = json.loads(capsys.readouterr().out)
    common = [x for x in range(1, 20) if x % 3]
    expected = correlate(common, [2.5 * x + (x % 2) * 4 for x in common])
    assert answer["common"] == len(common) == expected.count
    assert answer["pearson"] == vars(expected.pearson)
    assert answer["spearman"] == vars(expected.spearman)
    assert answer["rank_of_firsts_best_on_second"] == 2  # 1 is fastest there, and 2 here
    assert answer["rank_of_seconds_best_on_first"] == 2

    assert compare(devices, "--objectives", "seconds", "--log") == 0
    line = capsys.readouterr().out
    assert f"{len(common)} common configurations" in line
    assert f"Spearman {expected.spearman.value:.3f}" in line
    assert "number 2 on the second" in line


def test_compare_says_when_nothing_can_be_said(devices, capsys):
    (devices / "few.csv").write_text('x,mode,error,seconds\n1,c,1,1\n2,"a,b",2,2\n4,"a,b",3,1\n')
    assert compare(devices, "--objectives", "seconds", tables=("other.csv", "few.csv")) == 0
    assert "2 common configurations: too few for a correlation" in capsys.readouterr().out


def test_compare_of_three_devices_has_every_pair(devices, capsys):
    tables = ("table.csv", "other.csv", "table.csv")
    assert compare(devices, "--objectives", "seconds,error", "--json", tables=tables) == 0
    answers = json.loads(capsys.readouterr().out)
    assert [item["objective"] for item in answers] == ["seconds"] * 3 + ["error"] * 3
    assert answers[1]["pearson"]["value"] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("more", "tables", "message"),
    [
        (["--objectives", "seconds"], ("table.csv",), "two CSV files or more"),
        ([], ("table.csv", "table.csv"), "--objectives is missing"),
        (["--objectives", "watts"], ("table.csv", "table.csv"), "no column 'watts'"),
        (["--objectives", "seconds"], ("table.csv", "none.csv"), "No such file"),
        (["--objectives", "seconds"], ("table.csv", "bad.csv"), "bad.csv, line 3"),
    ],
)
def test_bad_input_of_compare_is_one_line_and_exit_code_2(devices, capsys, more, tables, message):
    (devices / "bad.csv").write_text("x,mode,seconds\n1,c,1\n99,c,1\n")
    assert compare(devices, *more, tables=tables) == 2
    assert message in complaint(capsys)


def test_measurements_are_read_with_failures_and_without_what_nobody_asked_for(devices):
    space = Space.from_dict(SPACE)
    read = read_measurements(devices / "other.csv", space, [Objective("seconds")])
    assert read[:3] == [
        ({"x": 1, "mode": "a,b"}, {"seconds": 6.5}),
        ({"x": 2, "mode": "a,b"}, {"seconds": 5.0}),
        ({"x": 3, "mode": "a,b"}, None),
    ]
    (devices / "odd.csv").write_text("x,mode,seconds\n1,c,inf\n2,c\n3,c,nan\n")
    assert [
        values for _, values in read_measurements(devices / "odd.csv", space, [Objective("seconds")])
    ] == [None] * 3
    (devices / "latin.csv").write_bytes(b"x,mode,seconds\n1,\xff,1\n")
    with pytest.raises(ScenarioError, match="UTF-8"):
        read_measurements(devices / "latin.csv", space, [Objective("seconds")])


def test_a_prior_guides_an_exploration_and_is_no_row_of_it(devices, capsys):
    ours = ["--method", "bayesian"]
    prior = [*ours, "--prior", str(devices / "other.csv")]
    assert explore(devices, "--budget", "6", *prior) == 0
    assert len(rows(devices / "out" / "evaluations.csv")) == 6
    phases = [row["phase"] for row in rows(devices / "out" / "evaluations.csv")]
    assert phases.count("active") == 3
    state = json.loads((devices / "out" / "state.json").read_text())
    assert len(state["prior"]) == 20
    assert explore(devices, "--budget", "9", *prior) == 0
    assert len(rows(devices / "out" / "evaluations.csv")) == 9

    capsys.readouterr()
    assert explore(devices, "--budget", "9", *ours, "--prior", str(devices / "table.csv")) == 2
    assert "began with another --prior" in capsys.readouterr().err
    assert explore(devices, "--budget", "9", *prior, "--method", "random", out="two") == 2
    assert "'random' cannot use a prior" in capsys.readouterr().err


def transfer(devices, *more):
    source = [str(devices / "table.csv"), "--space", str(devices / "space.json")]
    return main(["transfer", *source, "--objectives", "error,seconds", *more])


def test_transfer_prints_the_sources_front_by_expected_values(devices, capsys):
    (devices / "here.csv").write_text('x,mode,error,seconds\n4,"a,b",0.25,40\n5,"a,b",failed,50\n')
    here = ["--here", str(devices / "here.csv"), "--prefer", "seconds", "--limits", "error=0.2"]
    assert transfer(devices, *here) == 0
    printed = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    places = [int(row["x"]) for row in printed]
    assert places == [6, *range(8, 20), 1, 2, 3, 4]  # 5 failed here, 7 there
    assert float(printed[0]["seconds"]) == pytest.approx(60)
    assert float(printed[0]["source_seconds"]) == 6
    assert [row["x"] for row in printed if row["measured"] == "1"] == ["4"]
    assert [row["within_limits"] for row in printed] == ["1"] * 13 + ["0"] * 4


def xs(capsys):
    """The x of each row that a command has printed as CSV."""
    return [int(row["x"]) for row in csv.DictReader(io.StringIO(capsys.readouterr().out))]


@pytest.fixture
def marked(toy):
    """A table in which the best configurations are infeasible, and a scenario that says so."""
    lines = [f"{x},c,{1 / x},{x},{'TRUE' if x > 3 else 'no'}" for x in range(1, 9)]
    (toy / "marked.csv").write_text("\n".join(["x,mode,error,seconds,fits", *lines]) + "\n")
    feasible = {"feasible_output": {"name": "fits", "true_value": "true"}}
    (toy / "scenario.json").write_text(json.dumps(SCENARIO | feasible))
    return toy


@pytest.fixture(params=["scenario.json", "space.json"])
def problem(request, marked):
    """The options that name the space, the objectives and what is feasible."""
    named = [] if request.param == "scenario.json" else ["--feasible", "fits=true"]
    return ["--space", str(marked / request.param), "--objectives", "error,seconds", *named]


def test_transfer_leaves_out_what_is_infeasible(marked, problem, capsys):
    assert main(["transfer", str(marked / "marked.csv"), *problem]) == 0
    assert xs(capsys) == [8, 7, 6, 5, 4]


def test_infeasible_rows_of_a_warm_start_and_of_a_prior_are_failures(marked, problem):
    source = ["--command", "true {config}", "--budget", "1", "--no-picture", *problem]
    for name in ("warm-start", "prior"):
        out = marked / name
        main(["explore", *source, f"--{name}", str(marked / "marked.csv"), "--out", str(out)])
    assert [int(row["x"]) for row in rows(marked / "warm-start" / "front.csv")] == [8, 7, 6, 5, 4]
    state = json.loads((marked / "prior" / "state.json").read_text())
    assert [values for *_, values in state["prior"]].count([None]) == 3
    # evaluations.csv has no such column: its infeasible rows have no values.
    again = [*source, "--warm-start", str(marked / "warm-start" / "evaluations.csv")]
    main(["explore", *again, "--out", str(marked / "again")])
    assert len(rows(marked / "again" / "front.csv")) == 5


def test_the_front_of_a_table_and_a_comparison_leave_out_what_is_infeasible(marked, problem, capsys):
    table = str(marked / "marked.csv")
    assert main(["front", table, *problem]) == 0
    assert xs(capsys) == [8, 7, 6, 5, 4]
    assert main(["compare", table, table, *problem, "--json"]) == 0
    assert [pair["common"] for pair in json.loads(capsys.readouterr().out)] == [5, 5]


def test_the_front_of_a_table_without_a_space_leaves_out_what_is_infeasible(marked, capsys):
    source = ["front", str(marked / "marked.csv"), "--objectives", "error,seconds"]
    assert main([*source, "--feasible", "fits=true"]) == 0
    assert xs(capsys) == [8, 7, 6, 5, 4]
    assert main([*source, "--feasible", "fitz=true"]) == 2
    assert "no column 'fitz'" in capsys.readouterr().err


def test_a_column_of_feasibility_that_is_missing_or_misspelt_is_an_error(marked, capsys):
    source = [str(marked / "table.csv"), "--space", str(marked / "space.json"), "--objectives", "error"]
    assert main(["transfer", *source, "--feasible", "fitz=true"]) == 2
    assert "table.csv has no column 'fitz', which marks feasible" in capsys.readouterr().err
    assert main(["transfer", *source, "--feasible", "fits"]) == 2
    assert "write COLUMN=TEXT" in capsys.readouterr().err


def test_transfer_of_more_than_the_front_and_bad_input(devices, capsys):
    assert transfer(devices, "--count", "25") == 0
    assert len(capsys.readouterr().out.splitlines()) == 26
    assert transfer(devices, "--prefer", "watts") == 2
    assert "'watts' is not an objective" in capsys.readouterr().err
