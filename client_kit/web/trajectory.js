/** The error of a trajectory (slam/trajectories/trajectory.py), and its deviation from the reference trajectory. */

/**
 * The upper three rows of a pose, row by row: 12 numbers, camera to world, metres.
 * @typedef {ArrayLike<number>} Pose
 */

/** @typedef {ArrayLike<number>} Position x, y, z in metres */

/**
 * Distances in metres between true and estimated positions, after the first estimated pose whose truth is known
 * was laid on that truth. Frames without a true pose are left out; null where no frame has one. NaN where an
 * estimated pose is not finite.
 * @param {Pose[]} estimate
 * @param {(Pose | null)[]} truth of the same frames
 * @returns {{max: number, mean: number, rmse: number} | null}
 * @throws {RangeError} where the numbers of frames differ
 */
export function absoluteTrajectoryError(estimate, truth) {
  if (estimate.length !== truth.length) {
    throw new RangeError(`${estimate.length} estimated and ${truth.length} true poses`);
  }
  if (!estimate.every((pose) => Array.from(pose).every(Number.isFinite))) {
    return { max: NaN, mean: NaN, rmse: NaN };
  }
  const first = truth.findIndex(isKnown);
  if (first < 0) return null;
  const target = /** @type {Pose} */ (truth[first]);
  const rotation = product(rotationOf(target), inverse(rotationOf(estimate[first])));
  const start = positionOf(estimate[first]);
  const errors = [];
  for (const [frame, pose] of truth.entries()) {
    if (!isKnown(pose)) continue;
    const moved = positionOf(estimate[frame]).map((value, axis) => value - start[axis]);
    const found = [0, 1, 2].map(
      (row) => dot(rotation.slice(3 * row, 3 * row + 3), moved) + target[4 * row + 3],
    );
    errors.push(distance(found, positionOf(/** @type {Pose} */ (pose))));
  }
  const mean = (/** @type {number[]} */ values) => values.reduce((sum, value) => sum + value, 0) / values.length;
  return {
    max: Math.max(...errors),
    mean: mean(errors),
    rmse: Math.sqrt(mean(errors.map((error) => error * error))),
  };
}

/**
 * The largest distance (m) between the positions of the same frame; NaN where one is not finite. Both are in the
 * volume's frame: nothing is aligned.
 * @param {Position[]} positions
 * @param {Position[]} reference
 * @returns {number}
 * @throws {RangeError} where the numbers of frames differ
 */
export function deviation(positions, reference) {
  if (positions.length !== reference.length) {
    throw new RangeError(`${positions.length} positions, the reference has ${reference.length}`);
  }
  const distances = positions.map((position, frame) => distance(position, reference[frame]));
  return distances.every(Number.isFinite) ? Math.max(...distances) : NaN;
}

/**
 * The camera's position.
 * @param {Pose} pose
 * @returns {number[]}
 */
export function positionOf(pose) {
  return [pose[3], pose[7], pose[11]];
}

/**
 * @param {Pose | null} pose
 * @returns {boolean}
 */
function isKnown(pose) {
  return pose !== null && Array.from(pose).every(Number.isFinite);
}

/**
 * @param {Pose} pose
 * @returns {number[]} 3x3, row by row
 */
function rotationOf(pose) {
  return [pose[0], pose[1], pose[2], pose[4], pose[5], pose[6], pose[8], pose[9], pose[10]];
}

/**
 * @param {ArrayLike<number>} a
 * @param {ArrayLike<number>} b
 * @returns {number}
 */
function distance(a, b) {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

/**
 * @param {number[]} a
 * @param {number[]} b
 * @returns {number}
 */
function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/**
 * @param {number[]} a 3x3, row by row
 * @param {number[]} b
 * @returns {number[]}
 */
function product(a, b) {
  return a.map((_, index) => {
    const row = Math.floor(index / 3);
    const column = index % 3;
    return dot(a.slice(3 * row, 3 * row + 3), [b[column], b[3 + column], b[6 + column]]);
  });
}

/**
 * The inverse, not the transpose: an estimated rotation is orthonormal only to 32 bits.
 * @param {number[]} matrix 3x3, row by row
 * @returns {number[]}
 */
function inverse([a, b, c, d, e, f, g, h, i]) {
  const determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g);
  return [
    e * i - f * h, c * h - b * i, b * f - c * e,
    f * g - d * i, a * i - c * g, c * d - a * f,
    d * h - e * g, b * g - a * h, a * e - b * d,
  ].map((value) => value / determinant);
}
