"""The energy of a deformation, its derivatives, and what minimising it does to a map."""

from __future__ import annotations

import numpy as np
import pytest

from slam.elasticfusion.loops.graph import Graph
from slam.elasticfusion.loops.optimisation import Constraints, Energy, optimise
from tests.slam.numpy_kernels.dense import exponential


def corridor(nodes: int = 120) -> Graph:
    """Walls seen while going along a bent corridor at a node a tick."""
    random = np.random.default_rng(0)
    along = np.linspace(0, 3, nodes)
    middle = np.column_stack([np.sin(along), np.zeros(nodes), 2 * along])
    return Graph(middle + random.uniform(-0.5, 0.5, (nodes, 3)), np.arange(1, nodes + 1))


def gap(nodes: Graph, motion: np.ndarray, pairs: int = 40, seed: int = 1) -> Constraints:
    """The end of the corridor lies where `motion` has moved it from its beginning, where it should be."""
    random = np.random.default_rng(seed)
    targets = nodes.positions[:5].mean(axis=0) + random.uniform(-0.4, 0.4, (pairs, 3))
    sources = (targets - motion[:3, 3]) @ motion[:3, :3]  # the inverse motion of the targets
    last = int(nodes.times[-1])
    return Constraints(sources, np.full(pairs, last), targets, np.full(pairs, 3))


SHIFT = exponential(np.array([0.15, -0.05, 0.1, 0, 0, 0]))
TWIST = exponential(np.array([0.15, -0.05, 0.1, 0.05, -0.1, 0.02]))


def test_the_normal_equations_are_those_of_finite_differences():
    nodes = corridor(12)
    kept = gap(nodes, SHIFT, 3, seed=2)
    free = np.arange(12) >= 3
    energy = Energy(nodes, gap(nodes, TWIST, 4), kept, free)
    x = Energy.identity(12) + np.random.default_rng(3).normal(0, 0.1, (48, 3))
    columns = []
    for unknown in range(3 * 12, x.size):  # those of the free nodes
        change = np.zeros(x.size)
        change[unknown] = 1e-6
        change = change.reshape(x.shape)
        columns.append((energy.residuals(x + change) - energy.residuals(x - change)) / 2e-6)
    jacobian = np.column_stack(columns)
    matrix, gradient = energy.normal_equations(x)
    np.testing.assert_allclose(matrix.toarray(), jacobian.T @ jacobian, atol=1e-4)
    np.testing.assert_allclose(gradient, jacobian.T @ energy.residuals(x), rtol=1e-5, atol=1e-4)


def test_nothing_to_mend_has_no_energy():
    nodes = corridor()
    energy = Energy(nodes, gap(nodes, np.eye(4)), Constraints.none())
    assert energy(Energy.identity(len(nodes))) == pytest.approx(0, abs=1e-20)


@pytest.mark.parametrize("motion", [SHIFT, TWIST], ids=["shifted", "shifted and turned"])
def test_a_gap_is_closed_and_the_beginning_stays(motion):
    nodes = corridor()
    pairs = gap(nodes, motion)
    best = optimise(nodes, pairs)
    assert best is not None
    assert pairs.mean_distance() > 0.15
    assert best.distance < 2e-3
    assert best.energy < 0.12
    pinned, _ = best.deformation.of_points(pairs.targets, pairs.target_times)
    np.testing.assert_allclose(pinned, pairs.targets, atol=5e-3)


def test_a_known_deformation_is_recovered():
    """A corridor bent by a drift that grows evenly: its end is given, and the middle follows."""
    straight = corridor()
    drift = [
        exponential(np.array([0.2, 0.05, -0.1, 0, 0, 0]) * share)
        for share in np.linspace(0, 1, len(straight))
    ]
    drifted = Graph(
        np.array(
            [motion[:3, :3] @ p + motion[:3, 3] for motion, p in zip(drift, straight.positions, strict=True)]
        ),
        straight.times,
    )
    best = optimise(drifted, gap(drifted, np.linalg.inv(drift[-1])))
    assert best is not None
    mended, _ = best.deformation.of_points(drifted.positions, drifted.times)
    before = np.linalg.norm(drifted.positions - straight.positions, axis=1)
    after = np.linalg.norm(mended - straight.positions, axis=1)
    assert before.max() > 0.2
    assert after.mean() < 0.35 * before.mean()
    assert after[-1] < 0.01


def test_nodes_that_are_not_free_move_nothing():
    nodes = corridor()
    free = nodes.times > 40
    best = optimise(nodes, gap(nodes, SHIFT), free=free)
    assert best is not None
    assert not best.deformation.translations[~free].any()
    np.testing.assert_array_equal(best.deformation.rotations[~free], np.tile(np.eye(3), (40, 1, 1)))
    assert best.distance < 1e-3


def test_earlier_closures_stay_closed():
    nodes = corridor()
    beside = nodes.positions[80] + np.array([[0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    kept = Constraints(beside, np.full(3, 81), beside.copy(), np.full(3, 30))
    parted, together = (optimise(nodes, gap(nodes, SHIFT), earlier) for earlier in (None, kept))
    assert parted is not None
    assert together is not None
    assert kept.deformed(parted.deformation).mean_distance() > 0.05
    assert kept.deformed(together.deformation).mean_distance() < 0.005


def test_pairs_that_contradict_each_other_leave_a_high_energy():
    nodes = corridor()
    there, elsewhere = gap(nodes, SHIFT), gap(nodes, exponential(np.array([-0.4, 0.3, 0.2, 0, 0, 0])))
    both = there.joined(elsewhere)
    best = optimise(nodes, both)
    assert best is not None
    assert best.energy > 10
    assert optimise(nodes, both, give_up_above=10.0) is None


def test_too_few_nodes_or_none_free_give_no_deformation():
    nodes = corridor()
    few = Graph(nodes.positions[:4], nodes.times[:4])
    assert optimise(few, gap(nodes, SHIFT)) is None
    assert optimise(nodes, gap(nodes, SHIFT), free=np.zeros(len(nodes), bool)) is None


def test_nodes_in_one_line_have_a_solution_too():
    """Nothing but the constraints tells how they turn about the line."""
    nodes = Graph(np.column_stack([np.linspace(0, 5, 100), np.zeros((100, 2))]), np.arange(100))
    source, target = np.array([[0.5, 0.1, 0.0]]), np.array([[0.5, 0.0, 0.0]])
    best = optimise(nodes, Constraints(source, np.array([99]), target, np.array([10])))
    assert best is not None
    assert np.isfinite(best.deformation.translations).all()
    assert best.distance < 0.01


def test_equal_gaps_are_mended_equally():
    nodes = corridor()
    first, second = optimise(nodes, gap(nodes, TWIST)), optimise(nodes, gap(nodes, TWIST))
    assert first is not None
    assert second is not None
    np.testing.assert_array_equal(first.deformation.translations, second.deformation.translations)
