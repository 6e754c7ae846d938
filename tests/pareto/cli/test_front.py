"""python -m pareto front: filtering, choosing, and writing what is found."""

import json

import pytest

from pareto.cli.commands import main
from tests.pareto.conftest import explore, rows


def front(capsys, *arguments):
    """Run the command; return its exit code, its lines and its complaints."""
    capsys.readouterr()
    code = main(["front", *map(str, arguments)])
    output = capsys.readouterr()
    return code, output.out.splitlines(), output.err


@pytest.fixture
def explored(toy):
    """All of the toy's table, explored into a folder."""
    explore(toy, "--budget", "40")
    return toy / "out"


def test_a_folder_tells_its_front_and_is_only_read(explored, toy, capsys):
    written = (explored / "front.csv").read_text()
    (explored / "front.csv").unlink()
    before = {path.name: path.read_bytes() for path in explored.iterdir()}
    for place in ([explored], ["--space", toy / "space.json", "--out", explored]):
        code, lines, _ = front(capsys, *place)
        assert code == 0
        assert "\n".join(lines) + "\n" == written
    assert {path.name: path.read_bytes() for path in explored.iterdir()} == before


def test_limits_choice_and_knee_pick_from_a_folder(explored, capsys):
    _, lines, _ = front(capsys, explored, "--limits", "seconds=3", "--limit", "error=0.6")
    assert lines == ["x,mode,error,seconds", '3,"a,b",0.3333333333333333,3', '2,"a,b",0.5,2']
    _, lines, _ = front(capsys, explored, "--limits", "error=0.3", "--prefer", "seconds")
    assert lines[1:] == ['4,"a,b",0.25,4']
    _, lines, _ = front(capsys, explored, "--knee")
    assert lines[1:] == ['4,"a,b",0.25,4']


def test_limits_of_an_exploration_hold_unless_they_are_dropped_or_replaced(toy, capsys):
    explore(toy, "--budget", "40", "--limits", "seconds=3", out="tight")
    explore(toy, "--budget", "40", "--limits", "seconds=5", out="wide")
    _, lines, _ = front(capsys, toy / "tight")
    assert [line.split(",")[0] for line in lines[1:]] == ["3", "2", "1"]
    _, lines, _ = front(capsys, toy / "tight", "--limits", "error=0.06")
    assert [line.split(",")[0] for line in lines[1:]] == ["19", "18", "17"]
    _, lines, _ = front(capsys, toy / "tight", "--no-limits")
    assert len(lines) == 1 + 18

    both = [toy / "tight", toy / "wide"]
    code, _, complaints = front(capsys, *both)
    assert code == 2
    assert "wide has limits {'seconds': 5.0} and" in complaints
    assert "give --limits, or --no-limits" in complaints
    for choice, count in ((["--no-limits"], 18), (["--limits", "seconds=4"], 4)):
        code, lines, _ = front(capsys, *both, *choice)
        assert (code, len(set(lines[1:]))) == (0, count)
    code, _, complaints = front(capsys, toy / "tight", "--no-limits", "--limits", "seconds=4")
    assert code == 2
    assert "contradict" in complaints


def test_of_equally_good_points_the_one_chosen_is_not_beaten(toy, capsys):
    (toy / "t.csv").write_text("x,error,seconds,watts\n1,2,9,1\n2,2,3,1\n3,1,9,9\n4,2,4,1\n")
    _, lines, _ = front(
        capsys, toy / "t.csv", "--objectives", "error,seconds", "--limits", "watts=5", "--prefer", "error"
    )
    assert lines == ["x,error,seconds,watts", "2,2,3,1"]


def test_json_has_counts_as_whole_numbers(toy, capsys):
    (toy / "counts.csv").write_text("x,error,seconds\n1,1820556,.25\n")
    _, lines, _ = front(capsys, toy / "counts.csv", "--objectives", "error,seconds", "--format", "json")
    assert '"error": 1820556,' in "\n".join(lines)


def test_json_and_files(explored, toy, capsys):
    code, lines, _ = front(capsys, explored, "--prefer", "error", "--format", "json")
    best = {"configuration": {"x": 19, "mode": "a,b"}, "values": {"error": 1 / 19, "seconds": 19.0}}
    assert (code, json.loads("\n".join(lines))) == (0, [best])
    code, lines, _ = front(capsys, explored, "--output", toy / "mine.csv")
    assert (code, lines) == (0, [])
    assert len(rows(toy / "mine.csv")) == 18


def test_a_table_is_filtered_by_the_columns_named(toy, capsys):
    _, lines, _ = front(capsys, toy / "table.csv", "--objectives", "seconds,error", "--limits", "seconds=2")
    assert lines == ["x,mode,note,seconds,error", '1,"a,b",-,1,1', '2,"a,b",-,2,0.5']
    _, lines, _ = front(capsys, toy / "table.csv", "--objectives", "seconds", "--maximise", "seconds")
    assert [line.split(",")[0] for line in lines[1:]] == ["19", "19"]  # 7 has no error, but seconds


def test_with_a_space_the_rows_of_a_configuration_are_one_point(toy, capsys):
    table = toy / "repeated.csv"
    table.write_text(
        'x,mode,error,seconds,note\n1,"a,b",1.0,1,first\n1,"a,b",3.0,1,again\n2,"a,b",1.5,2,\n3,"a,b",1,oops,\n'
    )
    named = [table, "--objectives", "error,seconds"]
    _, lines, _ = front(capsys, *named)
    assert lines[1:] == ['1,"a,b",first,1,1']
    _, lines, _ = front(capsys, *named, "--space", toy / "space.json")
    assert lines == ["x,mode,error,seconds", '2,"a,b",1.5,2', '1,"a,b",2,1']
    _, lines, _ = front(capsys, *named, "--space", toy / "space.json", "--limits", "error=1.7")
    assert lines[1:] == ['2,"a,b",1.5,2']
    table.write_text('x,mode,error,seconds\n99,"a,b",1.0,1\n')
    code, _, complaints = front(capsys, *named, "--space", toy / "space.json")
    assert code == 2
    assert "line 2: parameter 'x': 99 is not one of" in complaints


def test_in_a_table_infinity_is_a_failure_and_a_column_given_twice_is_refused(toy, capsys):
    (toy / "t.csv").write_text("x,error,seconds\n1,1,-inf\n2,1,3\n3,nan,1\n")
    code, lines, complaints = front(capsys, toy / "t.csv", "--objectives", "error,seconds")
    assert (code, lines, complaints) == (0, ["x,error,seconds", "2,1,3"], "")
    (toy / "t.csv").write_text("error,x,error\n1,1,2\n")
    code, _, complaints = front(capsys, toy / "t.csv", "--objectives", "error")
    assert (code, complaints.count("\n")) == (2, 1)
    assert "more than one column 'error'" in complaints


def test_several_runs_have_one_front_or_what_they_all_attain(toy, capsys):
    explore(toy, "--budget", "8", "--seed", "1", out="one")
    explore(toy, "--budget", "8", "--seed", "2", out="two")
    _, union, _ = front(capsys, toy / "one", toy / "two")
    _, both, _ = front(capsys, toy / "one", toy / "two", "--attained", "2")
    _, either, _ = front(capsys, toy / "one", toy / "two", "--attained", "1")

    def values(lines):
        return [tuple(map(float, line.split(",")[-2:])) for line in lines[1:]]

    assert both[0] == "error,seconds"
    assert set(values(either)) == set(values(union))
    assert values(both) != values(either)
    assert len(both) > 1
    for run in ("one", "two"):
        _, alone, _ = front(capsys, toy / run)
        for error, seconds in values(both):
            assert any(e <= error and s <= seconds for e, s in values(alone))


def test_nothing_within_the_limits_is_said(explored, capsys):
    code, lines, complaints = front(capsys, explored, "--limits", "seconds=0.5")
    assert (code, lines) == (0, ["error,seconds"])
    assert "no point within the limits: 36 measured, 4 failed" in complaints
    code, _, complaints = front(capsys, explored, "--limits", "seconds=0.5", "--prefer", "error")
    assert code == 2
    assert "no point with seconds within 0.5: the best is 1" in complaints


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "give an exploration's folder"),
        (["{toy}/none"], "holds no exploration"),
        (["{toy}"], "holds no exploration"),
        (["{toy}/table.csv"], "name its objectives with --objectives"),
        (["{toy}/table.csv", "--objectives", "power"], "no column 'power'"),
        (["{toy}/table.csv", "--objectives", "error", "--prefer", "power"], "no column 'power'"),
        (["{toy}/binary", "--objectives", "a"], "not a CSV file in UTF-8"),
        (["{toy}/out", "--objectives", "error,power"], "did not measure 'power'"),
        (["{toy}/out", "--limits", "power=1"], "limit on 'power'"),
        (["{toy}/out", "--prefer", "power"], "'power' is not in this front"),
        (["{toy}/out", "--knee", "--prefer", "error"], "not allowed with"),
        (["{toy}/out", "--attained", "2"], "level 2 of 1 runs"),
        (["{toy}/out", "--space", "{toy}/none.json"], "cannot read the space"),
        (["{toy}/out", "{toy}/table.csv", "--objectives", "error"], None),
        (["{toy}/out", "{toy}/other", "--format", "csv"], "other objectives"),
        (["{toy}/out", "--output", "{toy}/none/x.csv"], "none/x.csv"),
    ],
)
def test_a_wrong_argument_is_one_line_and_exit_code_2(explored, toy, capsys, arguments, message):
    (toy / "binary").write_bytes(b"\xff\xfe\x00a")
    if "{toy}/other" in arguments:
        explore(toy, "--budget", "3", "--maximise", "error", out="other")
    code, _, complaints = front(capsys, *[argument.format(toy=toy) for argument in arguments])
    if message is None:
        assert (code, complaints) == (0, "")
        return
    assert code == 2
    assert message in complaints
    assert complaints.count("\n") == 1
