/** The record of a run, and when a run has failed (client_kit/measuring/run_record.py). */

import { MOST_LOST } from "./constants.js";
import { nextNumber, tracks } from "./plan.js";
import { absoluteTrajectoryError, deviation, positionOf } from "./trajectory.js";

const MICROSECONDS = 1e6;
// Chromium rounds timestamps to so many seconds.
const TIMESTAMP_QUANTUM = 65536e-9;
// Timestamps are used if they are plausible in this share of the frames.
const PLAUSIBLE = 0.95;

/** @typedef {import("./plan.js").Plan} Plan */
/** @typedef {import("./webgpu.js").Outcome} Outcome */
/** @typedef {import("./schedule.js").PlannedRun} PlannedRun */

/**
 * A run as the protocol sends it (docs/data/protocol.md). `deviation` is absent from a failed run, `stages_us` where no
 * clock measured the stages.
 * @typedef {import("./wire.d.ts").Run & {tracked: (boolean | null)[]}} Run
 */

/**
 * The references of a run: `trajectory` is the reference trajectory, `truth` the true poses of the frames.
 * @typedef {{trajectory: number[][], truth: (number[] | null)[]}} Expected
 */

/**
 * The positions of the camera after each frame.
 * @param {Outcome[]} frames
 * @returns {number[][]}
 */
export function positionsOf(frames) {
  return frames.map((frame) => positionOf(poseOf(frame)));
}

/**
 * A completed run.
 * @param {PlannedRun} planned
 * @param {Plan} plan
 * @param {Outcome[]} frames
 * @param {Expected} expected
 * @param {boolean} timed whether the device's clock measured the stages
 * @returns {Run}
 */
export function finishedRun(planned, plan, frames, expected, timed) {
  const ate = absoluteTrajectoryError(frames.map(poseOf), expected.truth);
  const far = deviation(positionsOf(frames), expected.trajectory);
  if (![far, ...Object.values(ate ?? {})].every(Number.isFinite)) {
    return failedRun(planned, "the trajectory is not finite", timed);
  }
  const tracked = trackedOf(plan, frames);
  const attempted = tracked.filter((found) => found !== null).length;
  const lost = tracked.filter((found) => found === false).length;
  const failed = attempted === 0 || lost > MOST_LOST * attempted;
  const frame_us = frames.map((frame) => Math.round(frame.seconds * MICROSECONDS));
  return {
    id: crypto.randomUUID(),
    ...planned,
    status: failed ? "failed" : "ok",
    failure: failed ? failureOf(lost, attempted) : null,
    frame_us,
    ...(timed ? { stages_us: stageMicroseconds(frames, frame_us) } : {}),
    tracked,
    ate_max: ate ? ate.max : null,
    ate_mean: ate ? ate.mean : null,
    ate_rmse: ate ? ate.rmse : null,
    ...(failed ? {} : { deviation: far }),
  };
}

/**
 * Whether each frame was tracked: null where that was not attempted, or the frame was left out.
 * @param {Plan} plan
 * @param {Outcome[]} frames
 * @returns {(boolean | null)[]}
 */
function trackedOf(plan, frames) {
  let number = 0;
  return frames.map(({ state, skipped }) => {
    const tracked = tracks(plan, number) && !skipped ? Boolean(state.tracked) : null;
    number = nextNumber(number, state);
    return tracked;
  });
}

/**
 * Why a run has failed (slam/validity.py).
 * @param {number} lost
 * @param {number} attempted
 * @returns {string}
 */
function failureOf(lost, attempted) {
  return attempted === 0 ? "no frame was tracked" : `tracking lost in ${lost} of ${attempted} frames`;
}

/**
 * An uncompleted run, with its REASON.
 * @param {PlannedRun} planned
 * @param {string} reason
 * @param {boolean} timed
 * @returns {Run}
 */
export function failedRun(planned, reason, timed) {
  return {
    id: crypto.randomUUID(),
    ...planned,
    status: "failed",
    failure: reason,
    frame_us: [],
    ...(timed ? { stages_us: {} } : {}),
    tracked: [],
    ate_max: null,
    ate_mean: null,
    ate_rmse: null,
  };
}

/**
 * Whether the device's clock is plausible: it advances, and in nearly all frames no stage is negative and their sum is
 * not longer than the frame.
 * @param {Outcome[]} frames
 * @returns {boolean}
 */
export function isPlausible(frames) {
  const plausible = frames.filter(({ stages, seconds }) => {
    const times = Object.values(stages ?? {});
    return times.every((time) => time >= 0) && sum(times) <= seconds + TIMESTAMP_QUANTUM;
  });
  const moves = frames.some(({ stages }) => sum(Object.values(stages ?? {})) > 0);
  return moves && plausible.length >= PLAUSIBLE * frames.length;
}

/**
 * Whole microseconds of each stage and frame. Their sum never exceeds the frame, even with a coarse clock.
 * @param {Outcome[]} frames
 * @param {number[]} frame_us
 * @returns {Record<string, number[]>}
 */
export function stageMicroseconds(frames, frame_us) {
  const names = Object.keys(frames[0]?.stages ?? {});
  /** @type {Record<string, number[]>} */
  const series = Object.fromEntries(names.map((name) => [name, []]));
  for (const [index, { stages }] of frames.entries()) {
    const times = names.map((name) => Math.max(stages?.[name] ?? 0, 0) * MICROSECONDS);
    const total = sum(times);
    const share = total > frame_us[index] ? frame_us[index] / total : 1;
    names.forEach((name, stage) => series[name].push(Math.floor(times[stage] * share)));
  }
  return series;
}

/**
 * @param {Outcome} frame
 * @returns {Float32Array}
 */
function poseOf({ state }) {
  return /** @type {Float32Array} */ (state.pose);
}

/**
 * @param {number[]} values
 * @returns {number}
 */
function sum(values) {
  return values.reduce((total, value) => total + value, 0);
}
