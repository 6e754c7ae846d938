"""The deformation that closes a loop: an energy over the graph's nodes, minimised by sparse Gauss-Newton.

Whelan et al. 2015, section 5.2, after Sumner et al. 2007. The unknowns of a node are a 3x3 matrix R and a
translation t. The new position of a point is linear in them, with equal coefficients for each coordinate. All
terms except that of the rotations therefore share one small sparse matrix, made once for all three
coordinates and all iterations.

One term is not in the paper: neighbours rotate alike. Without it a long chain of nodes bends at almost no
cost, and closing its ends moves the middle farther from the truth than the drift did.

scipy is imported on first use: runs without loop closure do not need it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from slam.elasticfusion.loops.graph import Deformation, Graph

if TYPE_CHECKING:
    from scipy import sparse

Array = NDArray[np.float64]

ROTATION_WEIGHT = 1.0
REGULARISATION_WEIGHT = 10.0
TURNING_WEIGHT = 1.0
CONSTRAINT_WEIGHT = 100.0
MOST_ITERATIONS = 3
SMALL_STEP = 1e-2  # norm over all unknowns
SMALL_ENERGY = 1e-3
SMALL_CHANGE = 1e-5  # of the energy, relative
DAMPING = 1e-6  # regularises what no residual constrains, such as a turn about nodes in a line
UNKNOWNS = 12  # of a node: the columns of R, then t
COLUMN_PAIRS = ((0, 1), (0, 2), (1, 2), (0, 0), (1, 1), (2, 2))  # whose products make R orthonormal


@dataclass(frozen=True)
class Constraints:
    """Pairs of points that are one and the same: `sources` born at `times`, `targets` at `target_times`.

    Points float64 (m, 3) in the world before the deformation, ticks int64 (m,).
    """

    sources: Array
    times: NDArray[np.int64]
    targets: Array
    target_times: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.times)

    @classmethod
    def none(cls) -> Constraints:
        return cls(np.empty((0, 3)), np.empty(0, np.int64), np.empty((0, 3)), np.empty(0, np.int64))

    def taken(self, rows: Any) -> Constraints:
        """The constraints that `rows` (a slice or an index) selects."""
        return Constraints(self.sources[rows], self.times[rows], self.targets[rows], self.target_times[rows])

    def joined(self, other: Constraints) -> Constraints:
        return Constraints(
            np.concatenate([self.sources, other.sources]),
            np.concatenate([self.times, other.times]),
            np.concatenate([self.targets, other.targets]),
            np.concatenate([self.target_times, other.target_times]),
        )

    def deformed(self, deformation: Deformation) -> Constraints:
        """The same pairs in the world after a deformation."""
        sources, _ = deformation.of_points(self.sources, self.times)
        targets, _ = deformation.of_points(self.targets, self.target_times)
        return Constraints(sources, self.times, targets, self.target_times)

    def mean_distance(self) -> float:
        """Metres between source and target; 0 where there is no pair."""
        distances = np.linalg.norm(self.sources - self.targets, axis=1)
        return float(distances.mean()) if len(self) else 0.0


class Energy:
    """The sum of squared residuals as a function of the unknowns x (4n, 3).

    Rows 4i to 4i + 2 of x are the columns of node i's R, row 4i + 3 is its t. `closing` pairs draw their
    sources to the targets, and pin the targets; `kept` pairs, of loops that were closed
    before, may move but stay together (Whelan et al. 2015, eq. 6 to 10). Nodes outside of `free` (n,) keep to
    the identity.
    """

    def __init__(
        self, graph: Graph, closing: Constraints, kept: Constraints, free: NDArray[np.bool_] | None = None
    ) -> None:
        from scipy import sparse

        self._free = np.ones(len(graph), bool) if free is None else free
        drawn, drawn_offsets = _point_rows(graph, closing.sources, closing.times)
        pinned, pinned_offsets = _point_rows(graph, closing.targets, closing.target_times)
        first, first_offsets = _point_rows(graph, kept.sources, kept.times)
        second, second_offsets = _point_rows(graph, kept.targets, kept.target_times)
        edges, edge_offsets = _edge_rows(graph)
        turns = _turning_rows(graph)
        terms = [
            (REGULARISATION_WEIGHT, edges, edge_offsets),
            (TURNING_WEIGHT, turns, np.zeros((turns.shape[0], 3))),
            (CONSTRAINT_WEIGHT, drawn, drawn_offsets - closing.targets),
            (CONSTRAINT_WEIGHT, pinned, pinned_offsets - closing.targets),
            (CONSTRAINT_WEIGHT, first - second, first_offsets - second_offsets),
        ]
        self._linear = sparse.vstack([np.sqrt(weight) * rows for weight, rows, _ in terms], format="csr")
        self._offsets = np.vstack([np.sqrt(weight) * offsets for weight, _, offsets in terms])
        self._free_columns = self._linear[:, np.repeat(self._free, 4)]
        self._shared = sparse.kron((self._free_columns.T @ self._free_columns), np.eye(3), format="csc")

    @staticmethod
    def identity(nodes: int) -> Array:
        """The unknowns of the identity."""
        return np.tile(np.vstack([np.eye(3), np.zeros(3)]), (nodes, 1))

    def residuals(self, x: Array) -> Array:
        """All residuals (r,), weighted by the roots of their terms' weights."""
        rotations = _orthonormality(x.reshape(-1, 4, 3)[:, :3])
        linear = self._linear @ x + self._offsets
        return np.concatenate([linear.ravel(), np.sqrt(ROTATION_WEIGHT) * rotations.ravel()])

    def __call__(self, x: Array) -> float:
        """The energy."""
        return float((self.residuals(x) ** 2).sum())

    def normal_equations(self, x: Array) -> tuple[sparse.csc_matrix, Array]:
        """J^T J and J^T r of the free nodes at x, J being the Jacobian of the residuals r."""
        from scipy import sparse

        columns = x.reshape(-1, 4, 3)[self._free, :3]
        jacobian = _orthonormality_jacobian(columns)
        residuals = _orthonormality(columns)
        count = len(columns)
        blocks = sparse.bsr_matrix(
            (
                ROTATION_WEIGHT * np.swapaxes(jacobian, 1, 2) @ jacobian,
                np.arange(count),
                np.arange(count + 1),
            ),
            shape=(UNKNOWNS * count, UNKNOWNS * count),
        )
        linear = self._free_columns.T @ (self._linear @ x + self._offsets)
        gradient = linear.ravel() + ROTATION_WEIGHT * np.einsum("nri,nr->ni", jacobian, residuals).ravel()
        return self._shared + blocks.tocsc(), gradient

    def step(self, x: Array) -> Array:
        """The Gauss-Newton step (4n, 3) from x; zero for nodes that are not free."""
        from scipy import sparse
        from scipy.sparse.linalg import splu

        matrix, gradient = self.normal_equations(x)
        damped = matrix + DAMPING * sparse.identity(len(gradient), format="csc")
        # Symmetric and positive definite: pivots stay on the diagonal, in the order of least fill-in.
        factors = splu(
            damped, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
        step = np.zeros((len(self._free), 4, 3))
        step[self._free] = -factors.solve(gradient).reshape(-1, 4, 3)
        return step.reshape(-1, 3)


@dataclass(frozen=True)
class Optimised:
    """A deformation, its energy, and the mean distance of the closing pairs after it."""

    deformation: Deformation
    energy: float
    distance: float


def optimise(
    graph: Graph,
    closing: Constraints,
    kept: Constraints | None = None,
    free: NDArray[np.bool_] | None = None,
    give_up_above: float = np.inf,
) -> Optimised | None:
    """The deformation of least energy, by at most MOST_ITERATIONS from the identity.

    It ends early where the energy rises (that step is not taken), or step, energy or change are small. None
    where the energy is above `give_up_above` after the first step, or nothing is free to move.
    """
    if not graph.usable or (free is not None and not free.any()):
        return None
    energy = Energy(graph, closing, kept or Constraints.none(), free)
    x = Energy.identity(len(graph))
    value = energy(x)
    for iteration in range(MOST_ITERATIONS):
        step = energy.step(x)
        after = energy(x + step)
        if not after < value:
            break
        x, before, value = x + step, value, after
        if iteration == 0 and value > give_up_above:
            return None
        if (
            np.linalg.norm(step) < SMALL_STEP
            or value < SMALL_ENERGY
            or before - value < SMALL_CHANGE * before
        ):
            break
    nodes = x.reshape(-1, 4, 3)
    deformation = Deformation(graph, np.swapaxes(nodes[:, :3], 1, 2), nodes[:, 3])
    moved, _ = deformation.of_points(closing.sources, closing.times)
    left = Constraints(moved, closing.times, closing.targets, closing.target_times).mean_distance()
    return Optimised(deformation, value, left)


def _edge_rows(graph: Graph) -> tuple[sparse.csr_matrix, Array]:
    """R_i (g_j - g_i) + g_i + t_i - (g_j + t_j) of each edge from i to j, as rows over x and offsets."""
    from scipy import sparse

    i, j = graph.edges().T
    reach = graph.positions[j] - graph.positions[i]
    values = np.column_stack([reach, np.ones(len(i)), -np.ones(len(i))])
    columns = np.column_stack([4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 3, 4 * j + 3])
    rows = np.repeat(np.arange(len(i)), 5)
    shape = (len(i), 4 * len(graph))
    return sparse.csr_matrix((values.ravel(), (rows, columns.ravel())), shape=shape), -reach


def _turning_rows(graph: Graph) -> sparse.csr_matrix:
    """R_i - R_j of each edge, column by column, as rows over x."""
    from scipy import sparse

    i, j = graph.edges().T
    values = np.tile([1.0, -1.0], 3 * len(i))
    columns = 4 * np.column_stack([i, j])[:, None] + np.arange(3)[:, None]
    rows = np.repeat(np.arange(3 * len(i)), 2)
    return sparse.csr_matrix((values, (rows, columns.ravel())), shape=(3 * len(i), 4 * len(graph)))


def _point_rows(graph: Graph, points: Array, times: NDArray[np.int64]) -> tuple[sparse.csr_matrix, Array]:
    """The new positions of points, as rows over x and offsets."""
    from scipy import sparse

    nodes, weights = graph.influence(points, times)
    g = graph.positions[nodes]
    values = weights[..., None] * np.concatenate([points[:, None] - g, np.ones((*nodes.shape, 1))], axis=-1)
    columns = 4 * nodes[..., None] + np.arange(4)
    rows = np.repeat(np.arange(len(points)), values[0].size if len(points) else 0)
    shape = (len(points), 4 * len(graph))
    matrix = sparse.csr_matrix((values.ravel(), (rows, columns.ravel())), shape=shape)
    return matrix, np.einsum("pk,pki->pi", weights, g)


def _orthonormality(columns: Array) -> Array:
    """(n, 6): what keeps the columns (n, 3, 3; the second axis numbers them) from being orthonormal."""
    products = columns @ np.swapaxes(columns, 1, 2) - np.eye(3)
    return np.stack([products[:, a, b] for a, b in COLUMN_PAIRS], axis=1)


def _orthonormality_jacobian(columns: Array) -> Array:
    """The derivatives (n, 6, UNKNOWNS) of `_orthonormality`."""
    jacobian = np.zeros((len(columns), len(COLUMN_PAIRS), UNKNOWNS))
    for row, (a, b) in enumerate(COLUMN_PAIRS):
        jacobian[:, row, 3 * a : 3 * a + 3] += columns[:, b]
        jacobian[:, row, 3 * b : 3 * b + 3] += columns[:, a]
    return jacobian
