/** How far a measurement has come, and how long the rest will take. */

import { MOST_BLOCKS_REPEATED, plannedRuns, runsOfABlock } from "./schedule.js";

const PREPARING = 0.05; // of the way: the recording is decoded
const PLANNED = 0.85; // of the way, with the planned runs; the rest is for blocks that are measured again

/** @typedef {import("./measurement.js").Message} Message */
/** @typedef {import("./schedule.js").Protocol} Protocol */

/**
 * The course of a session: each configuration that is left is checked once, then the runs that are left follow.
 */
export class Course {
  /** Seconds a frame of each configuration, as seen so far. @type {Map<string, number>} */
  #seconds = new Map();
  /** The first message of the current pass. @type {{key: string, frame: number, time: number} | null} */
  #first = null;
  #share = 0;

  /**
   * @param {Protocol} protocol
   * @param {number} done runs that a resumed session has
   */
  constructor(protocol, done) {
    const runs = plannedRuns(protocol).slice(done).map(({ configuration }) => configuration);
    /** The configuration of each pass over the recording. */
    this.passes = [...new Set(runs), ...runs];
    this.checks = this.passes.length - runs.length;
    this.done = done;
    this.planned = done + runs.length;
    /** The configurations of a block that is measured again. */
    this.block = plannedRuns(protocol).slice(0, runsOfABlock(protocol)).map(({ configuration }) => configuration);
  }

  /**
   * Where RUN is in the block that is measured again, or null for a planned one.
   * @param {number} run
   * @returns {{run: number, runs: number, earlier: number} | null} `earlier` blocks were measured again before
   */
  again(run) {
    const runs = this.block.length;
    const index = run - this.planned - 1;
    return index < 0 ? null : { run: (index % runs) + 1, runs, earlier: Math.floor(index / runs) };
  }

  /**
   * The share of the way at a MESSAGE that arrives at TIME (seconds), and the seconds that are left: null before any
   * frame was computed.
   * @param {Extract<Message, {type: "progress"}>} message
   * @param {number} time
   * @returns {{share: number, seconds: number | null}}
   */
  at({ phase, configuration, run, frame, frames }, time) {
    if (phase === "preparing") this.#share = Math.max(this.#share, (PREPARING * frame) / frames);
    if (phase === "preparing" || phase === "compiling") return { share: this.#share, seconds: null };
    this.#learn(`${phase} ${run} ${configuration}`, configuration, frame, time);
    const warmingUp = phase === "checking" && run > 0; // for a run, whose frames are still to come
    const part = warmingUp ? 0 : frame / frames;
    const again = this.again(run);
    const { passes, pass, from, to } = again ? this.#blockAgain(again) : this.#asPlanned(run, configuration);
    const share = from + ((to - from) * (pass + part)) / passes.length;
    this.#share = Math.max(this.#share, Math.min(share, 1));
    return { share: this.#share, seconds: this.#left(passes, pass, part * frames, frames) };
  }

  /**
   * @param {number} run
   * @param {string} configuration
   */
  #asPlanned(run, configuration) {
    const checked = this.passes.slice(0, this.checks).indexOf(configuration);
    const pass = Math.min(run ? this.checks + run - 1 - this.done : checked, this.passes.length - 1);
    return { passes: this.passes, pass, from: PREPARING, to: PLANNED };
  }

  /** @param {{run: number, earlier: number}} again */
  #blockAgain({ run, earlier }) {
    const size = (1 - PLANNED) / MOST_BLOCKS_REPEATED;
    const from = PLANNED + earlier * size;
    return { passes: this.block, pass: run - 1, from, to: from + size };
  }

  /**
   * @param {string} key of the pass
   * @param {string} configuration
   * @param {number} frame
   * @param {number} time
   */
  #learn(key, configuration, frame, time) {
    if (this.#first?.key !== key) this.#first = { key, frame, time };
    else if (frame > this.#first.frame) {
      this.#seconds.set(configuration, (time - this.#first.time) / (frame - this.#first.frame));
    }
  }

  /**
   * @param {string[]} passes
   * @param {number} pass
   * @param {number} frame
   * @param {number} frames
   * @returns {number | null}
   */
  #left(passes, pass, frame, frames) {
    if (!this.#seconds.size) return null;
    const slowest = Math.max(...this.#seconds.values());
    const seconds = passes.map((name) => frames * (this.#seconds.get(name) ?? slowest));
    const rest = seconds.slice(pass + 1).reduce((sum, each) => sum + each, 0);
    return rest + (seconds[pass] * (frames - frame)) / frames;
  }
}
