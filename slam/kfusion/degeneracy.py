"""Whether the normal equations of tracking constrain the camera in every direction.

In front of a flat wall the camera may slide and turn along it, and the point-to-plane error does not change:
the pose passes its check though the camera is elsewhere (Gelfand et al. 2003; Zhang, Kaess and Singh 2016).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]

# Mean squared error per pixel, m^2, that moving by a metre or turning by a radian causes at least. Measured:
# docs/research/tracking-checks.md.
WEAK_DIRECTION = 0.005


def weakest_direction(normal_matrix: Array, inliers: float, centre: Array) -> float:
    """The smallest eigenvalue of J^T J about the camera, per inlier; 0 without inliers.

    `normal_matrix` (21,) is the upper triangle of J^T J row by row, for a twist about the volume's corner
    (translation in metres, then rotation in radians). `centre` (3,) is the camera's position, about which the
    twist is taken here: otherwise the result would depend on where the volume's corner lies.
    """
    if not inliers > 0:
        return 0.0
    matrix = np.zeros((6, 6))
    matrix[np.triu_indices(6)] = normal_matrix
    matrix += np.triu(matrix, 1).T
    x, y, z = (float(value) for value in centre)
    shift = np.eye(6)
    # p x n becomes (p - c) x n, which is p x n - c x n.
    shift[3:, :3] = -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return max(float(np.linalg.eigvalsh(shift @ matrix @ shift.T)[0]) / inliers, 0.0)


def is_degenerate(normal_matrix: Array, inliers: float, centre: Array) -> bool:
    """Whether a direction is weaker than WEAK_DIRECTION; arguments as in `weakest_direction`."""
    return weakest_direction(normal_matrix, inliers, centre) < WEAK_DIRECTION
