"""Tree ensembles over a grid: grown by scikit-learn, predicted for the whole space at once.

A node of a tree over a grid covers an axis-aligned box of it. Adding plus and minus a number at the box's
corners, and then summing along each axis, paints all boxes of all trees in one pass: the cost is that of
the corners and of one prefix sum an axis, not of rows times trees times depth. What is painted is, for
each split, the step from its left to its right side over the right side's box: an inner node's box has
fewer corners than a leaf's. The sums are int64 in fixed point. Wrapping overflow cancels out, so equal
predictions stay exactly equal; in floating point they would differ in the last digit and invent points of
a front.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

LARGEST_GRID = 5_000_000  # points that are predicted all
CORNERS_AT_ONCE = 1 << 18  # a few MB of working memory, which the cache half holds


@dataclass(frozen=True)
class Boxes:
    """The boxes of a sum over trees: one for each split, and one for each root.

    Box i covers low[i] <= code < high[i] on every axis and adds value[plus[i]] - value[minus[i]], nodes
    of all trees; one past the last node means 0 (a root has no left side to step from).
    """

    low: NDArray[np.int32]
    high: NDArray[np.int32]
    plus: NDArray[np.int64]
    minus: NDArray[np.int64]
    value: NDArray[np.float64]
    trees: int


class Forest:
    """A fitted ensemble of regression trees on value positions ("codes") of a grid of `shape`."""

    def __init__(self, estimator: Any, shape: tuple[int, ...]) -> None:
        self.estimator = estimator
        self.shape = shape

    @classmethod
    def grow(
        cls,
        codes: NDArray[np.integer],
        targets: NDArray[np.float64],
        shape: tuple[int, ...],
        *,
        seed: int,
        trees: int = 100,
        extra: bool = True,
    ) -> Forest:
        """Fit `trees` trees to (n, axes) codes and n targets.

        `extra` grows extremely randomised trees on all rows (Geurts et al. 2006), otherwise Breiman's random
        forest on bootstrap samples.
        """
        from sklearn.ensemble import ExtraTreesRegressor, RandomForestRegressor

        kind = ExtraTreesRegressor if extra else RandomForestRegressor
        estimator = kind(n_estimators=trees, random_state=seed)
        return cls(estimator.fit(np.asarray(codes, dtype=np.float32), targets), shape)

    def predict(self, codes: NDArray[np.integer]) -> NDArray[np.float64]:
        """Return the mean over trees at (n, axes) codes: scikit-learn's, without the costs of each call."""
        rows = np.asarray(codes, dtype=np.float32)
        total = np.zeros(len(rows))
        for tree in self.estimator.estimators_:
            total += tree.tree_.predict(rows)[:, 0]
        return total / len(self.estimator.estimators_)

    def predict_with_spread(
        self, codes: NDArray[np.integer]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return mean and standard deviation over trees at (n, axes) codes."""
        rows = np.asarray(codes, dtype=np.float32)
        first, *others = [tree.predict(rows, check_input=False) for tree in self.estimator.estimators_]
        # Welford 1962: one pass, and no difference of large squares.
        mean, squares = first.copy(), np.zeros_like(first)
        for number, value in enumerate(others, start=2):
            step = value - mean
            mean += step / number
            squares += step * (value - mean)
        return mean, np.sqrt(squares / (len(others) + 1))

    def predict_grid(self) -> NDArray[np.float64]:
        """Return the mean over trees for every point of the grid, in index order.

        Equal to `predict` on all codes up to rounding (about 1e-15 of the largest value), and exactly equal
        wherever two points lie in the same leaves.
        """
        boxes = self.boxes()
        offset = _middle(boxes.value)
        [mean] = _means(boxes, [boxes.value - offset], self.shape)
        return mean + offset

    def predict_grid_with_spread(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return mean and standard deviation over trees for every point of the grid, in index order.

        The mean as in `predict_grid`. The variance is a difference of squares: deviations below about 1e-7 of
        the values' range are rounding, larger ones have nine digits and more.
        """
        boxes = self.boxes()
        offset = _middle(boxes.value)
        centred = boxes.value - offset
        mean, variance = _means(boxes, [centred, centred**2], self.shape)
        variance -= mean**2
        mean += offset
        return mean, np.sqrt(np.maximum(variance, 0.0, out=variance), out=variance)

    def boxes(self) -> Boxes:
        """Return the boxes of all trees.

        By induction, a node's own box, painted with the value of its leftmost leaf, and the steps of the
        splits below it add up to its subtree. The trees are walked together, a level at a time.
        """
        trees = [estimator.tree_ for estimator in self.estimator.estimators_]
        first_node = np.cumsum([0, *(tree.node_count for tree in trees)])
        roots, nodes = first_node[:-1], int(first_node[-1])
        own_root = np.repeat(roots, np.diff(first_node))
        left = np.concatenate([tree.children_left for tree in trees])
        inner = left >= 0
        left = np.where(inner, left + own_root, -1)
        right = np.concatenate([tree.children_right for tree in trees]) + own_root
        axis = np.concatenate([tree.feature for tree in trees])
        # The first code that goes right:
        bound = np.floor(np.concatenate([tree.threshold for tree in trees])).astype(np.int32) + 1

        axes = len(self.shape)
        sides = np.zeros((nodes, 2 * axes), dtype=np.int32)  # a node's low codes and, behind them, its high
        sides[:, axes:] = self.shape
        level = roots
        while len(level := level[inner[level]]):
            box, rows, split, at = sides[level], np.arange(len(level)), axis[level], bound[level]
            high = box[rows, axes + split]
            box[rows, axes + split] = at
            sides[left[level]] = box
            box[rows, axes + split] = high
            box[rows, split] = at
            sides[right[level]] = box
            level = np.concatenate([left[level], right[level]])

        leftmost = np.arange(nodes)
        while len(higher := np.flatnonzero(inner[leftmost])):
            leftmost[higher] = left[leftmost[higher]]
        splits = np.flatnonzero(inner)
        painted = np.concatenate([roots, right[splits]])
        return Boxes(
            low=sides[painted, :axes],
            high=sides[painted, axes:],
            plus=leftmost[painted],
            minus=np.concatenate([np.full(len(trees), nodes), leftmost[left[splits]]]),
            value=np.concatenate([tree.value[:, 0, 0] for tree in trees]),
            trees=len(trees),
        )


def paint(
    low: NDArray[np.integer], high: NDArray[np.integer], values: NDArray[np.int64], shape: tuple[int, ...]
) -> NDArray[np.int64]:
    """Return, for every point of a grid of `shape`, the sums of `values` over the boxes that cover it.

    Boxes are low <= code < high on every axis. `values` is (layers, boxes), the answer (layers, points) in
    C order. Exact modulo 2**64.
    """
    grid = np.zeros((len(values), math.prod(shape)), dtype=np.int64)
    strides = np.array([math.prod(shape[axis + 1 :]) for axis in range(len(shape))])
    origin = low @ strides
    step = (high - low) * strides
    # A box that reaches the end of an axis has no second corner there: its difference falls off the grid.
    closed = high < np.array(shape)
    closed_axes = closed.sum(axis=1)
    for axes in range(int(closed_axes.max(initial=0)) + 1):
        boxes = np.flatnonzero(closed_axes == axes)
        at_once = max(1, CORNERS_AT_ONCE >> axes)
        for start in range(0, len(boxes), at_once):
            some = boxes[start : start + at_once]
            steps = step[some][closed[some]].reshape(len(some), axes)
            corners = np.empty((1 << axes, len(some)), dtype=np.int64)
            signed = np.empty_like(corners)
            corners[0] = origin[some]
            for column in range(axes):
                np.add(corners[: 1 << column], steps[:, column], out=corners[1 << column : 2 << column])
            for layer, value in zip(grid, values, strict=True):
                signed[0] = value[some]
                for column in range(axes):
                    np.negative(signed[: 1 << column], out=signed[1 << column : 2 << column])
                np.add.at(layer, corners.ravel(), signed.ravel())
    with ThreadPoolExecutor(len(grid)) as threads:
        list(threads.map(lambda layer: _accumulate(layer, shape), grid))
    return grid


def _accumulate(grid: NDArray[np.int64], shape: tuple[int, ...]) -> None:
    for axis, size in enumerate(shape):
        after = math.prod(shape[axis + 1 :])
        view = grid.reshape(-1, size, after)
        if after < 16:
            np.cumsum(view, axis=1, out=view)
        else:
            for code in range(1, size):
                view[:, code] += view[:, code - 1]


def _means(
    boxes: Boxes, values: list[NDArray[np.float64]], shape: tuple[int, ...]
) -> list[NDArray[np.float64]]:
    """Return, for each of `values` (a number a node), its mean over trees at every point of the grid."""
    # The sum over trees must stay below 2**62; sums on the way there may wrap, which cancels out.
    ones = 2.0 ** (61 - math.ceil(math.log2(boxes.trees)))
    fixed = np.empty((len(values), len(boxes.plus)), dtype=np.int64)
    units = []
    for row, value in zip(fixed, values, strict=True):
        largest = float(np.abs(value).max()) or 1.0
        scaled = np.append(np.rint(value / largest * ones), 0.0).astype(np.int64)
        row[:] = scaled[boxes.plus] - scaled[boxes.minus]
        units.append(largest / ones)
    sums = paint(boxes.low, boxes.high, fixed, shape)
    return [layer * (unit / boxes.trees) for layer, unit in zip(sums, units, strict=True)]


def _middle(values: NDArray[np.float64]) -> float:
    """Return the middle of the values' range: values around it have most digits in fixed point."""
    return float((values.min() + values.max()) / 2)
