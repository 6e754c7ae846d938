/** The device's times of a frame's stages. */

import { stagesOf } from "./plan.js";

/** @typedef {import("./plan.js").Plan} Plan */
/** @typedef {import("./gpu-device.js").Device} Device */

/** The timestamps of a frame's passes, read back after the state. */
export class StageClock {
  /**
   * @param {GPUQuerySet} queries
   * @param {GPUBuffer} resolved
   * @param {string[]} stages
   * @param {number} place of the timestamps in the memory that is read back
   */
  constructor(queries, resolved, stages, place) {
    this.queries = queries;
    this.resolved = resolved;
    this.stageNames = stages;
    this.place = place;
    this.readbackBytes = place + resolved.size;
  }

  /**
   * @param {Device} device
   * @param {Plan} plan
   * @param {number} passes at most in a frame
   * @param {number} stateBytes
   * @returns {Promise<StageClock>}
   */
  static async create(device, plan, passes, stateBytes) {
    const count = 2 * Math.max(passes, 1);
    const { QUERY_RESOLVE, COPY_SRC } = GPUBufferUsage;
    return device.created("timestamps", () => {
      const queries = device.gpu.createQuerySet({ type: "timestamp", count });
      const resolved = device.gpu.createBuffer({ size: 8 * count, usage: QUERY_RESOLVE | COPY_SRC });
      return new StageClock(queries, resolved, stagesOf(plan), Math.ceil(stateBytes / 8) * 8);
    });
  }

  /**
   * The timestamp writes of pass INDEX of a frame.
   * @param {number} index
   * @returns {GPUComputePassTimestampWrites}
   */
  writes(index) {
    return {
      querySet: this.queries,
      beginningOfPassWriteIndex: 2 * index,
      endOfPassWriteIndex: 2 * index + 1,
    };
  }

  /**
   * Copy the times of a frame's passes after the state.
   * @param {GPUCommandEncoder} encoder
   * @param {number} passes
   * @param {GPUBuffer} readback
   */
  resolve(encoder, passes, readback) {
    if (!passes) return;
    encoder.resolveQuerySet(this.queries, 0, 2 * passes, this.resolved, 0);
    encoder.copyBufferToBuffer(this.resolved, 0, readback, this.place, 16 * passes);
  }

  /**
   * Seconds of each stage: from the first begin to the last end of its passes, 0 where nothing was launched.
   * Passes overlap on tiled GPUs, so their sum would be too large.
   * @param {ArrayBuffer} data what was read back
   * @param {{stage: string}[]} taking the segments of the frame
   * @returns {Record<string, number>}
   */
  stages(data, taking) {
    const times = new BigUint64Array(data, this.place, 2 * taking.length);
    /** @type {Map<string, [bigint, bigint]>} */
    const spans = new Map();
    for (const [index, { stage }] of taking.entries()) {
      const [begin, end] = [times[2 * index], times[2 * index + 1]];
      const [first, last] = spans.get(stage) ?? [begin, end];
      spans.set(stage, [begin < first ? begin : first, end > last ? end : last]);
    }
    return Object.fromEntries(
      this.stageNames.map((stage) => {
        const [begin, end] = spans.get(stage) ?? [0n, 0n];
        return [stage, 1e-9 * Number(end - begin)];
      }),
    );
  }

  destroy() {
    this.queries.destroy();
    this.resolved.destroy();
  }
}
