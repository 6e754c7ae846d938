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
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

CORNERS_AT_ONCE = 1 << 18  # a few MB of working memory, which the cache half holds


@dataclass(frozen=True)
class Boxes:
    """What to paint for a sum over trees: a box for each split, and one for each root.

    Box i covers low[i] <= code < high[i] on every axis and adds value[plus[i]] - value[minus[i]], where the
    last entry of `value` stands for nothing (a root has no left side to step from).
    """

    low: NDArray[np.int64]
    high: NDArray[np.int64]
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
        leaf: int = 1,
    ) -> Forest:
        """Fit `trees` trees to (n, axes) codes and n targets.

        `extra` grows extremely randomised trees on all rows (Geurts et al. 2006), otherwise Breiman's random
        forest on bootstrap samples; `leaf` is the least number of rows in a leaf.
        """
        from sklearn.ensemble import ExtraTreesRegressor, RandomForestRegressor

        kind = ExtraTreesRegressor if extra else RandomForestRegressor
        estimator = kind(n_estimators=trees, min_samples_leaf=leaf, random_state=seed)
        return cls(estimator.fit(np.asarray(codes, dtype=np.float32), targets), shape)

    def predict(self, codes: NDArray[np.integer]) -> NDArray[np.float64]:
        """Return the mean over trees at (n, axes) codes."""
        return self.estimator.predict(np.asarray(codes, dtype=np.float32))

    def predict_grid(self) -> NDArray[np.float64]:
        """Return the mean over trees for every point of the grid, in index order.

        Equal to `predict` on all codes up to rounding (about 1e-15 of the largest value), and exactly equal
        wherever two points lie in the same leaves.
        """
        boxes = self.boxes()
        offset, sums = _centred_sums(boxes, boxes.value, self.shape)
        return sums / boxes.trees + offset

    def predict_grid_with_spread(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return mean and standard deviation over trees for every point of the grid, in index order."""
        boxes = self.boxes()
        offset, sums = _centred_sums(boxes, boxes.value, self.shape)
        mean = sums / boxes.trees
        base, squares = _centred_sums(boxes, (boxes.value - offset) ** 2, self.shape)
        variance = squares / boxes.trees + base - mean**2
        return mean + offset, np.sqrt(np.maximum(variance, 0.0))

    def boxes(self) -> Boxes:
        """Return the boxes of all trees."""
        trees = [estimator.tree_ for estimator in self.estimator.estimators_]
        values = [tree.value[:, 0, 0] for tree in trees]
        first_node = np.cumsum([0, *map(len, values)])
        parts = [_boxes(tree, self.shape) for tree in trees]
        low, high = (np.concatenate([part[side] for part in parts]) for side in (0, 1))
        plus = np.concatenate([part[2] + first for part, first in zip(parts, first_node, strict=False)])
        minus = np.concatenate(
            [
                np.where(part[3] < 0, first_node[-1], part[3] + first)
                for part, first in zip(parts, first_node, strict=False)
            ]
        )
        return Boxes(low, high, plus, minus, np.concatenate([*values, [0.0]]), trees=len(trees))


def paint(
    low: NDArray[np.int64], high: NDArray[np.int64], value: NDArray[np.int64], shape: tuple[int, ...]
) -> NDArray[np.int64]:
    """Return, for every point of a grid of `shape`, the sum of `value` over the boxes that cover it.

    Boxes are low <= code < high on every axis; the answer is flat, in C order. Exact modulo 2**64.
    """
    grid = np.zeros(math.prod(shape), dtype=np.int64)
    strides = np.array([math.prod(shape[axis + 1 :]) for axis in range(len(shape))])
    origin = low @ strides
    step = (high - low) * strides
    # A box that reaches the end of an axis has no second corner there: its difference falls off the grid.
    closed = high < np.array(shape)
    closed_axes = closed.sum(axis=1)
    for axes in range(int(closed_axes.max(initial=0)) + 1):
        boxes = np.flatnonzero(closed_axes == axes)
        sign = np.array([1], dtype=np.int64)
        for _ in range(axes):
            sign = np.concatenate([sign, -sign])
        at_once = max(1, CORNERS_AT_ONCE >> axes)
        for start in range(0, len(boxes), at_once):
            some = boxes[start : start + at_once]
            steps = step[some][closed[some]].reshape(len(some), axes)
            corners = origin[some, None]
            for column in range(axes):
                corners = np.concatenate([corners, corners + steps[:, column, None]], axis=1)
            np.add.at(grid, corners.ravel(), (value[some, None] * sign).ravel())
    _accumulate(grid, shape)
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


def _centred_sums(
    boxes: Boxes, value: NDArray[np.float64], shape: tuple[int, ...]
) -> tuple[float, NDArray[np.float64]]:
    """Return (offset, sums): at every point, sums + trees * offset is the sum of its leaves' values."""
    offset = float((value[:-1].min() + value[:-1].max()) / 2)
    largest = float(np.abs(value[:-1] - offset).max())
    if largest == 0.0:
        return offset, np.zeros(math.prod(shape))
    # The sum over trees must stay below 2**62; sums on the way there may wrap, which cancels out.
    exponent = 61 - math.ceil(math.log2(boxes.trees)) - math.frexp(largest)[1]
    fixed = np.rint(np.ldexp(np.append(value[:-1] - offset, 0.0), exponent)).astype(np.int64)
    sums = paint(boxes.low, boxes.high, fixed[boxes.plus] - fixed[boxes.minus], shape)
    return offset, np.ldexp(sums.astype(np.float64), -exponent)


def _boxes(tree: Any, shape: tuple[int, ...]) -> tuple[NDArray[np.int64], ...]:
    """Return (low, high, plus, minus) of one tree; plus and minus are nodes, -1 for none.

    By induction, a node's own box, painted with the value of its leftmost leaf, and the steps of the splits
    below it add up to its subtree.
    """
    left, right, feature = tree.children_left, tree.children_right, tree.feature
    bound = np.floor(tree.threshold).astype(np.int64) + 1  # the first code that goes right
    low = np.zeros((tree.node_count, len(shape)), dtype=np.int64)
    high = np.tile(np.array(shape, dtype=np.int64), (tree.node_count, 1))
    level = np.array([0])
    while len(level := level[left[level] >= 0]):
        for children in (left[level], right[level]):
            low[children], high[children] = low[level], high[level]
        high[left[level], feature[level]] = bound[level]
        low[right[level], feature[level]] = bound[level]
        level = np.concatenate([left[level], right[level]])
    leftmost = np.arange(tree.node_count)
    while (inner := left[leftmost] >= 0).any():
        leftmost[inner] = left[leftmost[inner]]
    splits = np.flatnonzero(left >= 0)
    painted = np.concatenate([[0], right[splits]])
    minus = np.concatenate([[-1], leftmost[left[splits]]])
    return low[painted], high[painted], leftmost[painted], minus
