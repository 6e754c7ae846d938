"""Looking measurements up in a table."""

import pytest

from pareto.errors import EvaluationError, ScenarioError
from pareto.evaluation import from_table
from pareto.objective import read_objectives
from pareto.space import Space
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
    with pytest.raises(ScenarioError, match="no CSV file in UTF-8"):
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


def test_rows_that_constraints_forbid_do_no_harm(toy):
    space = Space.from_dict(SPACE | {"constraints": ["x <= 5"]})
    evaluate = from_table(toy / "table.csv", space, OBJECTIVES)
    assert evaluate({"x": 5, "mode": "a,b"}) == {"error": 0.2, "seconds": 5.0}
