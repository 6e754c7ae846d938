"""Algorithm 1 from the rows of one file: what is known is not measured again, and nothing else changes."""

import shutil

import pytest

from frontrunner.paper.exploration import explore, measure_references
from slam.isolated import MeasurementError
from tests.frontrunner.paper.toy import Program, study


def rows_of(folder):
    """Number, phase, parameters and values of each row, without the seconds and what follows."""
    return [line.split(",")[:-3] for line in (folder / "evaluations.csv").read_text().splitlines()]


def stop_after(number, folder, **budget):
    """A search that was killed, of which only the rows are left."""
    with pytest.raises(KeyboardInterrupt):
        explore(study(**budget), folder, Program(number))
    for path in folder.iterdir():
        if path.name != "evaluations.csv":
            path.unlink()


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The folder of a search without a break, and how many configurations it measured."""
    folder, program = tmp_path_factory.mktemp("whole"), Program()
    explore(study(), folder, program)
    return folder, len(program.measured)


@pytest.mark.parametrize(
    "budget",
    [{}, pytest.param({"batch": None, "iterations": None}, marks=pytest.mark.slow)],
    ids=["small", "full"],
)
def test_a_search_killed_twice_measures_what_one_without_a_break_measures(tmp_path, budget):
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    program = Program()
    expected = explore(study(**budget), whole, program)

    stop_after(5, broken, **budget)
    stop_after(9, broken, **budget)  # 14 rows: amid the first iteration
    last = Program()
    exploration = explore(study(**budget), broken, last)

    assert len(last.measured) == len(program.measured) - 14
    assert rows_of(broken) == rows_of(whole)
    assert (exploration.iterations, exploration.ended) == (expected.iterations, expected.ended)
    assert exploration.explorer.history.results == expected.explorer.history.results


def test_a_torn_row_is_measured_again(tmp_path, whole):
    stop_after(14, tmp_path)
    path = tmp_path / "evaluations.csv"
    path.write_text(path.read_text()[:-9])
    program = Program()
    explore(study(), tmp_path, program)
    assert len(program.measured) == whole[1] - 13


def test_a_finished_search_measures_nothing_more(tmp_path, whole):
    shutil.copytree(whole[0], tmp_path, dirs_exist_ok=True)
    rows = rows_of(tmp_path)
    explore(study(), tmp_path, Program(most=0))
    assert rows_of(tmp_path) == rows


def test_iterations_and_their_size_are_the_budget(tmp_path):
    exploration = explore(study(batch=2, iterations=3), tmp_path, Program())
    phases = list(exploration.explorer.history.phases.values())
    assert not exploration.ended
    assert exploration.iterations == len(exploration.refits) == 3
    assert (phases.count("random"), phases.count("active")) == (12, 6)


def test_without_a_limit_algorithm_1_goes_on_until_its_predicted_front_is_measured(tmp_path):
    exploration = explore(study(batch=None, iterations=None), tmp_path, Program())
    assert exploration.ended
    predicted = [
        exploration.explorer.space.encode(item) for item, _ in exploration.explorer.predicted_front()
    ]
    assert set(predicted) <= exploration.explorer.history.results.keys()


def test_rows_of_another_budget_count_too_and_are_named(tmp_path, capsys):
    explore(study(iterations=1), tmp_path, Program())
    program = Program()
    exploration = explore(study(random=20, iterations=1), tmp_path, program)
    results = exploration.explorer.history.results
    assert len(rows_of(tmp_path)) - 1 == len(results) == 12 + 3 + len(program.measured)
    assert "configurations that Algorithm 1 does not ask for" in capsys.readouterr().err


def test_a_failure_is_a_row_with_its_reason(tmp_path):
    exploration = explore(study(), tmp_path, Program())
    assert len(exploration.explorer.history.failed())
    assert "exit code 1: it crashed" in (tmp_path / "evaluations.csv").read_text()


def test_references_are_measured_in_turn_and_only_as_often_as_missing(tmp_path):
    slow = {"size": 32, "rate": 1, "kernel": "box", "fast": False}
    searched = study(references={"slow": slow})
    first = measure_references(searched, tmp_path, Program(), 1)
    program = Program()
    assert measure_references(searched, tmp_path, program, 3) == first
    assert program.measured == [searched.space().default, slow] * 2
    assert list(first) == ["default", "slow"]
    assert first["slow"]["runtime"] == pytest.approx(32**1.5)


def test_a_default_that_cannot_be_measured_ends_the_search_before_it_begins(tmp_path):
    def broken(_):
        raise MeasurementError("exit code 2: cv2 is missing")

    with pytest.raises(MeasurementError, match="the default of kfusion cannot be measured: exit code 2: cv2"):
        measure_references(study(), tmp_path, broken, 1)
