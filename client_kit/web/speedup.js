/** The results of a session, computed as on the server (wire/session_statistics.py). */

import {
  LEAST_DEVIATION, LEAST_PAIRS, QUANTILES_95, QUANTILES_99, SLOWDOWN_LEVEL, WIDEST_INTERVAL,
} from "./constants.js";

const MICROSECONDS = 1e6;

/** @typedef {import("./run-record.js").Run} Run */

/**
 * The part of a manifest's protocol that decides whether a run counts.
 * @typedef {{first_counted_frame: number, max_ate: number}} Counting
 */

/**
 * The largest deviation (m) that counts, by the configuration's name.
 * @typedef {Record<string, number>} Bands
 */

/**
 * The speedup over the baseline. `low` and `high` bound it with 95 % confidence within this session. They are null for
 * too few pairs of runs. `changed`: it changed within the session, beyond chance.
 * @typedef {{value: number, low: number | null, high: number | null, pairs: number, changed: boolean}} Speedup
 */

/**
 * The run's value: mean seconds a frame over the frames that count.
 * @param {Run} run
 * @param {Counting} protocol
 * @returns {number}
 */
export function meanSeconds(run, protocol) {
  return mean(run.frame_us.slice(protocol.first_counted_frame)) / MICROSECONDS;
}

/**
 * Mean seconds a frame of each stage, over the frames that count; empty where no clock measured them.
 * @param {Run} run
 * @param {Counting} protocol
 * @returns {Record<string, number>}
 */
export function stageSeconds(run, protocol) {
  const stages = Object.entries(run.stages_us ?? {});
  return Object.fromEntries(
    stages.map(([stage, series]) => [stage, mean(series.slice(protocol.first_counted_frame)) / MICROSECONDS]),
  );
}

/**
 * Whether the run's speed counts: it ran, and its trajectory stayed within the limits.
 * @param {Run} run
 * @param {Counting} protocol
 * @param {Bands} bands
 * @returns {boolean}
 */
export function isValid(run, protocol, bands) {
  const band = bands[run.configuration];
  const { ate_max = null, deviation = null } = run;
  const deviates = deviation !== null && band !== undefined && deviation > band;
  return run.status === "ok" && ate_max !== null && ate_max < protocol.max_ate && !deviates;
}

/**
 * exp of the mean of the paired log ratios, with their t interval. The first run of one configuration is paired
 * with the first of the other, the second with the second. Null without a pair of valid runs.
 * @param {Run[]} runs of one session
 * @param {string} configuration
 * @param {Counting} protocol
 * @param {Bands} bands
 * @param {string} [baseline]
 * @returns {Speedup | null}
 */
export function speedupOf(runs, configuration, protocol, bands, baseline = "default") {
  const valid = runs.filter((run) => isValid(run, protocol, bands));
  const seconds = new Map(
    valid.filter((run) => run.configuration === baseline).map((run) => [run.repeat, meanSeconds(run, protocol)]),
  );
  const logs = [];
  for (const run of valid) {
    const before = seconds.get(run.repeat);
    if (run.configuration === configuration && before !== undefined) {
      logs.push(Math.log(before / meanSeconds(run, protocol)));
    }
  }
  if (!logs.length) return null;
  const centre = mean(logs);
  const pairs = logs.length;
  if (pairs < LEAST_PAIRS) return { value: Math.exp(centre), low: null, high: null, pairs, changed: false };
  const half = QUANTILES_95[Math.min(pairs - 1, QUANTILES_95.length) - 1] * Math.sqrt(variance(logs) / pairs);
  return {
    value: Math.exp(centre),
    low: Math.exp(centre - half),
    high: Math.exp(centre + half),
    pairs,
    changed: speedupChanges(logs),
  };
}

/**
 * Whether the second half of the log ratios differs from the first by more than chance: Student's test of two samples
 * at level 0.01.
 * @param {number[]} logs
 * @returns {boolean}
 */
function speedupChanges(logs) {
  const half = Math.floor(logs.length / 2);
  if (half < 2) return false;
  const [first, second] = [logs.slice(0, half), logs.slice(-half)];
  const change = Math.abs(mean(second) - mean(first));
  const deviation = Math.max(Math.sqrt((variance(first) + variance(second)) / 2), LEAST_DEVIATION);
  return change > QUANTILES_99[2 * half - 3] * deviation * Math.sqrt(2 / half);
}

/**
 * Whether the interval of a speedup is too wide to show one number for it; false without one.
 * @param {Speedup} speedup
 * @returns {speedup is Speedup & {low: number, high: number}}
 */
export function isWide(speedup) {
  const { low, high } = speedup;
  return low !== null && high !== null && high > WIDEST_INTERVAL * low;
}

/**
 * How many times longer the later runs of a session took; null where that can be chance, or did not last.
 *
 * In each configuration, every run of the second half took longer than every run of the first, by LEAST_DEVIATION.
 * @param {Run[]} runs of one session
 * @param {Counting} protocol
 * @returns {number | null}
 */
export function slowedDown(runs, protocol) {
  const good = runs.filter(({ status }) => status === "ok").sort((a, b) => a.order - b.order);
  const changes = [];
  let chance = 1;
  for (const name of new Set(good.map(({ configuration }) => configuration))) {
    const times = good.filter(({ configuration }) => configuration === name).map((run) => meanSeconds(run, protocol));
    const half = Math.floor(times.length / 2);
    if (!half) continue;
    const [earlier, later] = [times.slice(0, half), times.slice(-half)];
    if (Math.min(...later) <= Math.exp(LEAST_DEVIATION) * Math.max(...earlier)) return null;
    for (let each = 1; each <= half; each++) chance *= each / (half + each);
    changes.push(Math.log(mean(later) / mean(earlier)));
  }
  return chance <= SLOWDOWN_LEVEL ? Math.exp(mean(changes)) : null;
}

/**
 * @param {number[]} values
 * @returns {number}
 */
export function mean(values) {
  return values.reduce((sum, value) => sum + value, 0) / values.length;
}

/**
 * @param {number[]} values
 * @returns {number} the sample variance
 */
function variance(values) {
  const centre = mean(values);
  return values.reduce((sum, value) => sum + (value - centre) ** 2, 0) / (values.length - 1);
}
