/** The runs of a session in their order (client_kit/delivery/manifest.py). */

/** @typedef {import("./wire.d.ts").Protocol} Protocol */

export const MOST_BLOCKS_REPEATED = 2; // after the planned runs, where other programs disturbed them

/** A planned run. @typedef {{configuration: string, repeat: number, order: number}} PlannedRun */

/**
 * All runs of a session: the protocol's order, forwards and back, until each configuration has its repeats.
 * @param {Pick<Protocol, "order" | "repeats">} protocol
 * @returns {PlannedRun[]}
 */
export function plannedRuns({ order, repeats }) {
  const count = (/** @type {string[]} */ names, /** @type {string} */ name) =>
    names.filter((each) => each === name).length;
  const wanted = Math.max(repeats, count(order, "default"));
  let round = [...order];
  let names = [...order];
  while (names.length && order.some((name) => count(names, name) < wanted)) {
    round = round.reverse();
    names = [...names, ...round];
  }
  return names.map((configuration, index) => ({
    configuration,
    repeat: count(names.slice(0, index), configuration),
    order: index,
  }));
}

/**
 * The runs of a block: each configuration forwards and back. A disturbed block is measured again as a whole.
 * @param {Pick<Protocol, "order">} protocol
 * @returns {number}
 */
export function runsOfABlock({ order }) {
  return 2 * new Set(order).size;
}
