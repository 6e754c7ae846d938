/** The processor as a device: a WebAssembly module, and the threads that execute it. */

import { oneLine, messageOf } from "./gpu-device.js";

const TEAMS = [1, 2, 4]; // numbers of threads that are tried; 4 are the fast cores of most phones
// A module that needs what ours needs: 128-bit vectors and a shared memory.
const SAMPLE = new Uint8Array([
  0, 97, 115, 109, 1, 0, 0, 0, 1, 4, 1, 96, 0, 0, 3, 2, 1, 0, 5, 4, 1, 3, 1, 1, 10, 9, 1, 7, 0, 65, 0, 253, 15, 26, 11,
]);

/**
 * Whether this browser executes our module.
 * @returns {boolean}
 */
export function canExecute() {
  return typeof WebAssembly === "object" && WebAssembly.validate(SAMPLE);
}

/**
 * The numbers of threads to try: none where the page is not isolated, so that one alone can compute.
 * @returns {number[]}
 */
export function teams() {
  return globalThis.crossOriginIsolated ? [...TEAMS] : [];
}

/** A module, compiled, and how many threads execute it. */
export class Processor {
  /** Of the stages: the host's, from call to call. @type {"wall"} */
  stageClock = "wall";

  /**
   * @param {WebAssembly.Module} module
   * @param {number} threads
   */
  constructor(module, threads) {
    this.module = module;
    this.threads = threads;
  }

  /**
   * @param {BufferSource} content of the module's file
   * @param {number} threads
   * @returns {Promise<Processor>}
   */
  static async open(content, threads) {
    try {
      return new Processor(await WebAssembly.compile(content), threads);
    } catch (error) {
      throw new Error(oneLine(`this browser refused the WebAssembly module: ${messageOf(error)}`));
    }
  }

  /** Release it: executions have released theirs. */
  close() {}
}
