"""Looking measurements up in a table."""

import pytest

from pareto.errors import EvaluationError, ObjectiveError, ScenarioError
from pareto.fronts.objective import read_objectives
from pareto.measuring.measurements import read_measurements
from pareto.measuring.table import from_table
from pareto.spaces.space import Space
from tests.pareto.conftest import SPACE

OBJECTIVES = read_objectives(["error", "seconds"])


def test_a_table_that_does_not_fit_the_space_is_refused(toy):
    space = Space.from_dict(SPACE)
    with pytest.raises(ScenarioError, match="no column 'power'"):
        from_table(toy / "table.csv", space, read_objectives(["power"]))
    (toy / "bad.csv").write_text("x,mode,error,seconds\n1,c,1,1\n99,c,1,1\n")
    with pytest.raises(ScenarioError, match="line 3: parameter 'x'"):
        from_table(toy / "bad.csv", space, OBJECTIVES)
    (toy / "short.csv").write_text("x,mode,error,seconds\n1\n")
    with pytest.raises(ScenarioError, match="line 2: parameter 'mode'"):
        from_table(toy / "short.csv", space, OBJECTIVES)
    (toy / "binary.csv").write_bytes(b"x,mode,error,seconds\n\xff\xfe\n")
    with pytest.raises(ScenarioError, match="not a CSV file in UTF-8"):
        from_table(toy / "binary.csv", space, OBJECTIVES)
    for unreadable in (toy / "none.csv", toy):
        with pytest.raises(ScenarioError, match="cannot read"):
            from_table(unreadable, space, OBJECTIVES)


def test_the_feasible_column_decides_whether_a_row_counts(toy):
    (toy / "t.csv").write_text("x,mode,error,seconds,Valid\n1,c,1,1,TRUE\n2,c,1,1,false\n")
    evaluate = from_table(toy / "t.csv", Space.from_dict(SPACE), OBJECTIVES, feasible=("Valid", "true"))
    assert evaluate({"x": 1, "mode": "c"}) == {"error": 1.0, "seconds": 1.0}
    with pytest.raises(EvaluationError, match="Valid is false"):
        evaluate({"x": 2, "mode": "c"})
    with pytest.raises(EvaluationError, match="not in the table"):
        evaluate({"x": 3, "mode": "c"})


def test_several_rows_of_a_configuration_are_measurements_of_it(toy):
    lines = [
        "x,mode,error,seconds",
        "1,c,1,1",
        "1,c,inf,9",
        "1,c,3,2",
        "2,c,oops,1",
        "2,c,nan,1",
        "3,c,0.1,0.3",
    ]
    (toy / "t.csv").write_text("\n".join(lines) + "\n")
    evaluate = from_table(toy / "t.csv", Space.from_dict(SPACE), OBJECTIVES)
    assert evaluate({"x": 1, "mode": "c"}) == {"error": 2.0, "seconds": 1.5}
    assert evaluate({"x": 3, "mode": "c"}) == {"error": 0.1, "seconds": 0.3}
    with pytest.raises(EvaluationError, match="error is 'nan' in the table, not a finite number"):
        evaluate({"x": 2, "mode": "c"})


def test_columns_that_mean_two_things_are_refused(toy):
    space = Space.from_dict(SPACE)
    with pytest.raises(ObjectiveError, match="'x' has the name of a parameter"):
        from_table(toy / "table.csv", space, read_objectives(["x"]))
    with pytest.raises(ObjectiveError, match="'mode' has the name of a parameter"):
        read_measurements(toy / "table.csv", space, read_objectives(["error", "mode"]))
    (toy / "twice.csv").write_text("x,mode,error,seconds,error\n1,c,1,1,2\n")
    with pytest.raises(ScenarioError, match="more than one column 'error'"):
        from_table(toy / "twice.csv", space, OBJECTIVES)
    with pytest.raises(ScenarioError, match="more than one column 'error'"):
        read_measurements(toy / "twice.csv", space, OBJECTIVES)


def test_rows_that_constraints_forbid_do_no_harm(toy):
    space = Space.from_dict(SPACE | {"constraints": ["x <= 5"]})
    evaluate = from_table(toy / "table.csv", space, OBJECTIVES)
    assert evaluate({"x": 5, "mode": "a,b"}) == {"error": 0.2, "seconds": 5.0}
