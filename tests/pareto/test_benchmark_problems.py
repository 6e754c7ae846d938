"""What bench-pareto compares searches by: exact regret, and one table of look-ups for all peers."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from tests.benchmarks import synthetic_kernel
from tests.benchmarks.pareto_problems import Problem, convolution
from tests.benchmarks.peers.table import BudgetSpentError, Table
from tests.builders.spaces import parameter, space_of

SPACE = space_of(a=[1, 2, 4], fixed=[7], b=parameter(["x", "y"], default="y"))
VALUES = np.array([[1.0, 8.0], [2.0, 2.0], [8.0, 1.0], [4.0, 4.0], [np.nan, np.nan], [16.0, 16.0]])


def problem(limits: tuple[float, float] | None = None) -> Problem:
    return Problem("small", SPACE, VALUES, limits, {"worst": (16.0, 16.0)}, (2,))


def table(folder: Path, **changes: object) -> Table:
    np.save(folder / "values.npy", VALUES)
    request = {
        "space": SPACE.to_dict(),
        "values": str(folder / "values.npy"),
        "limits": None,
        "allowed": None,
        "factors": None,
        "budget": 3,
        "seed": 0,
        "method": "",
    }
    return Table(request | changes)


def test_regret_is_nothing_for_the_whole_front_and_everything_for_failures() -> None:
    assert problem().regret([2, 0, 1, 5], "worst") == pytest.approx(0.0, abs=1e-12)
    assert problem().regret([4, 5], "worst") == 1.0
    # From (16, 16), in powers of two: (2, 2) covers 3 x 3, the others of the front add 1 x 1 each.
    assert problem().regret([1], "worst") == pytest.approx(2 / 11)


def test_a_problem_is_another_one_with_other_values_or_limits() -> None:
    assert problem().digest == problem().digest
    assert problem().digest != problem(limits=(8.0, 8.0)).digest


def test_noise_is_part_of_a_problem_and_the_same_for_every_search_of_a_seed() -> None:
    noisy = problem().noisy(0.05)
    assert noisy.digest != problem().digest
    assert problem().factors(1) is None
    np.testing.assert_array_equal(noisy.factors(1), noisy.factors(1))
    assert not np.array_equal(noisy.factors(1), noisy.factors(2))
    assert 0.045 < np.log(noisy.factors(1)).std() < 0.055


def test_the_measured_front_takes_means_and_forgets_what_failed() -> None:
    noisy = problem().noisy(0.5)
    measured = VALUES[[0, 1, 1, 4]] * noisy.factors(3)[:4]
    means = np.array([measured[0], measured[1:3].mean(axis=0)])
    beaten = (means[::-1] < means).all(axis=1)
    assert noisy.measured_front([0, 1, 1, 4], 3) == [place for place in (0, 1) if not beaten[place]]


def test_a_table_multiplies_each_look_up_by_its_factor(tmp_path: Path) -> None:
    np.save(tmp_path / "factors.npy", np.array([[2.0, 1.0], [0.5, 1.0], [1.0, 1.0]]))
    looked_up = table(tmp_path, factors=str(tmp_path / "factors.npy"))
    first, second = (looked_up.evaluate({"a": 0, "b": 0}).objectives for _ in range(2))
    assert first == pytest.approx(np.log([2.0, 8.0]))
    assert second == pytest.approx(np.log([0.5, 8.0]))


def test_the_table_numbers_points_like_the_space_and_counts_duplicates(tmp_path: Path) -> None:
    looked_up = table(tmp_path)
    assert looked_up.default == {"a": 0, "b": 1}
    for positions in ({"a": 1, "b": 0}, {"a": 1, "b": 0}, {"a": 2, "b": 1}):
        outcome = looked_up.evaluate(positions)
    assert outcome.objectives == pytest.approx(tuple(np.log(VALUES[5])))
    assert looked_up.indices == [SPACE.encode({"a": 2, "fixed": 7, "b": "x"})] * 2 + [5]
    with pytest.raises(BudgetSpentError):
        looked_up.evaluate({"a": 0, "b": 0})


def test_limits_are_constraints_and_a_failed_point_breaks_them_all(tmp_path: Path) -> None:
    looked_up = table(tmp_path, limits=[4.0, 16.0])
    inside, outside, failed = (looked_up.evaluate({"a": a, "b": 0}) for a in (0, 1, 2))
    assert inside.feasible
    assert inside.excess == pytest.approx((np.log(1 / 4), np.log(8 / 16)))
    assert not outside.feasible
    assert outside.excess[0] == pytest.approx(np.log(8 / 4))
    assert not failed.feasible
    assert failed.excess == (1.0, 1.0)
    # The worst that was seen of each objective stands in for what was not measured.
    assert failed.objectives == pytest.approx((np.log(8), np.log(8)))


def test_what_a_known_constraint_forbids_costs_no_evaluation(tmp_path: Path) -> None:
    np.save(tmp_path / "allowed.npy", np.array([True, True, False, True, True, True]))
    looked_up = table(tmp_path, allowed=str(tmp_path / "allowed.npy"))
    assert not looked_up.evaluate({"a": 1, "b": 0}).feasible
    assert (looked_up.indices, looked_up.refused) == ([], 1)
    looked_up.evaluate({"a": 1, "b": 1})
    assert (looked_up.indices, looked_up.refused) == ([3], 1)


def test_a_sixth_of_the_made_up_kernels_cannot_be_launched() -> None:
    assert len(synthetic_kernel.SPACE) == 2_150_400
    values = synthetic_kernel.evaluate(np.arange(0, len(synthetic_kernel.SPACE), 101))
    failed = np.isnan(values).any(axis=1)
    assert 0.15 < failed.mean() < 0.2
    assert (values[~failed] > 0).all()


@pytest.mark.slow
@pytest.mark.skipif("FRONTRUNNER_DATA" not in os.environ, reason="needs the tables in FRONTRUNNER_DATA")
def test_the_restrictions_of_the_convolution_are_what_its_table_leaves_out() -> None:
    folder = Path(os.environ["FRONTRUNNER_DATA"]) / "dse" / "convolution"
    constrained, unconstrained = (convolution(folder, with_constraints=each) for each in (True, False))
    assert constrained.space.allowed_grid.sum() == 4362
    assert not np.isfinite(unconstrained.values[~constrained.space.allowed_grid]).any()
    np.testing.assert_array_equal(constrained.values, unconstrained.values)
    assert json.dumps(constrained.space.to_dict()) != json.dumps(unconstrained.space.to_dict())
