/** The results of a session (client_kit/measuring/session.py), computed as on the server. */

const MICROSECONDS = 1e6;
const LEAST_PAIRS = 3; // pairs needed for an interval: two pairs give a uselessly wide one
// Student's t, two-sided 95 %, for 1 to 24 degrees of freedom: a session has at most 25 pairs of runs.
const T_QUANTILES = [
  12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179,
  2.16, 2.145, 2.131, 2.12, 2.11, 2.101, 2.093, 2.086, 2.08, 2.074, 2.069, 2.064,
];

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
 * too few pairs of runs.
 * @typedef {{value: number, low: number | null, high: number | null, pairs: number}} Speedup
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
  const deviates = run.deviation !== undefined && band !== undefined && run.deviation > band;
  return run.status === "ok" && run.ate_max !== null && run.ate_max < protocol.max_ate && !deviates;
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
  if (pairs < LEAST_PAIRS) return { value: Math.exp(centre), low: null, high: null, pairs };
  const quantile = T_QUANTILES[Math.min(logs.length - 1, T_QUANTILES.length) - 1];
  const variance = logs.reduce((sum, log) => sum + (log - centre) ** 2, 0) / (logs.length - 1);
  const half = quantile * Math.sqrt(variance / logs.length);
  return {
    value: Math.exp(centre),
    low: Math.exp(centre - half),
    high: Math.exp(centre + half),
    pairs,
  };
}

/**
 * The slowdown of the second half of a configuration's good runs over the first: median over the counted
 * frames of the ratio of their means. Null with fewer than two such runs.
 * @param {Run[]} runs of one session
 * @param {string} configuration
 * @param {Counting} protocol
 * @returns {number | null}
 */
export function drift(runs, configuration, protocol) {
  const good = runs
    .filter((run) => run.configuration === configuration && run.status === "ok")
    .map((run) => run.frame_us.slice(protocol.first_counted_frame));
  const half = Math.floor(good.length / 2);
  if (!half) return null;
  const [earlier, later] = [good.slice(0, half), good.slice(good.length - half)];
  const ratios = [];
  for (let frame = 0; frame < good[0].length; frame++) {
    const [before, after] = [earlier, later].map((series) => series.map((times) => times[frame]));
    if (before.every(Boolean) && after.every(Boolean)) ratios.push(mean(after) / mean(before));
  }
  return ratios.length ? median(ratios) : null;
}

/**
 * @param {number[]} values
 * @returns {number}
 */
function mean(values) {
  return values.reduce((sum, value) => sum + value, 0) / values.length;
}

/**
 * @param {number[]} values
 * @returns {number}
 */
function median(values) {
  const sorted = [...values].sort((a, b) => a - b);
  const middle = Math.floor(sorted.length / 2);
  return sorted.length % 2 ? sorted[middle] : (sorted[middle - 1] + sorted[middle]) / 2;
}
