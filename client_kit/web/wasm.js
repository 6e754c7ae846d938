/** The execution of a plan in WebAssembly (slam/plans/wasm.py). */

import { DoesNotFitError } from "./gpu-device.js";
import {
  argumentWords, bufferBytes, bufferOf, checkPlan, idleStages, initialState, kernelOf, readState, segmentsOf,
  servedState, stateBuffer, takesPlace,
} from "./plan.js";

// As slam/devices/wasm.py places things in memory.
const PAGE = 2 ** 16;
const OWN = PAGE; // bytes at the start that belong to the module
const ALIGNMENT = 64; // of all that is placed
const STACK = 2 ** 16; // bytes for each thread; its work-item lies above it
const WORD = 4;
const MIB = 2 ** 20;

/** @typedef {import("./plan.js").Plan} Plan */
/** @typedef {import("./plan.js").Dispatch} Dispatch */
/** @typedef {import("./plan.js").State} State */
/** @typedef {import("./processor.js").Processor} Processor */
/** @typedef {import("./webgpu.js").Outcome} Outcome */
/** @typedef {{run: (team: number, list: number, count: number, threads: number) => void}} Program */

/** A plan in WebAssembly, ready for its first frame. */
export class WasmExecution {
  /** The first address of each plane of a buffer, by the buffer's name. @type {Map<string, number[]>} */
  #places = new Map();
  /** @type {{stage: string, dispatches: Dispatch[], list: number}[]} */
  #segments = [];
  /** @type {Worker[]} */
  #others = [];
  /** @type {Program | null} */
  #program = null;
  /** @type {Uint8Array} */
  #bytes;
  /** @type {State} */
  #lastState = {}; // as last read
  #served = 0; // frames that were left out since

  /**
   * @param {Processor} processor
   * @param {Plan} plan
   */
  constructor(processor, plan) {
    this.plan = plan;
    this.threads = processor.threads;
    let end = OWN + ALIGNMENT + this.threads * (STACK + ALIGNMENT);
    for (const buffer of plan.buffers) {
      const stride = aligned(bufferBytes(plan, buffer) / buffer.planes);
      this.#places.set(buffer.name, Array.from({ length: buffer.planes }, (_, plane) => end + plane * stride));
      end += buffer.planes * stride;
    }
    /** @type {[number, Uint32Array][]} */
    const words = [];
    for (const { stage, dispatches } of segmentsOf(plan)) {
      const list = new Uint32Array(dispatches.length);
      for (const [index, dispatch] of dispatches.entries()) {
        const launch = this.#launch(dispatch);
        words.push([end, launch]);
        list[index] = end;
        end = aligned(end + launch.byteLength);
      }
      words.push([end, list]);
      this.#segments.push({ stage, dispatches, list: end });
      end = aligned(end + list.byteLength);
    }
    this.memory = newMemory(end);
    this.#bytes = new Uint8Array(this.memory.buffer);
    for (const [address, launch] of words) this.#words(address, launch.length).set(launch);
    for (const { name, fill, planes } of plan.buffers.filter(({ fill }) => fill)) {
      const length = bufferBytes(plan, bufferOf(plan, name)) / planes / WORD;
      for (const address of this.#places.get(name) ?? []) this.#words(address, length).fill(fill);
    }
    this.write(stateBuffer(plan).name, initialState(plan));
    this.#lastState = readState(plan, initialState(plan));
  }

  /**
   * Prepare PLAN, whose kernels are those of the module of PROCESSOR.
   * @param {Processor} processor
   * @param {Plan} plan
   * @returns {Promise<WasmExecution>}
   * @throws {DoesNotFitError} where the browser has no memory left for it
   */
  static async create(processor, plan) {
    checkPlan(plan, "rows");
    const execution = new WasmExecution(processor, plan);
    try {
      await execution.#start(processor.module);
    } catch (error) {
      execution.destroy();
      throw error;
    }
    return execution;
  }

  /**
   * Execute what takes place in frame NUMBER over IMAGE.
   * @param {number} number
   * @param {Uint16Array<ArrayBuffer> | null} image millimetres; null keeps the last one
   * @returns {Promise<Outcome>}
   */
  async run(number, image) {
    if (!this.#program) throw new Error("the execution was ended");
    const began = performance.now();
    const served = servedState(this.plan, this.#lastState, this.#served);
    if (served) {
      this.#served += 1;
      const seconds = (performance.now() - began) / 1000;
      return { state: served, seconds, stages: idleStages(this.plan), skipped: true };
    }
    this.#served = 0;
    if (image) this.write(this.plan.input, image);
    const stages = idleStages(this.plan);
    for (const { stage, dispatches, list } of this.#segments) {
      if (!takesPlace(dispatches[0], number, this.#lastState)) continue;
      const before = performance.now();
      this.#program.run(OWN, list, dispatches.length, this.threads);
      stages[stage] += (performance.now() - before) / 1000;
    }
    this.#lastState = readState(this.plan, this.#content(stateBuffer(this.plan).name));
    const seconds = (performance.now() - began) / 1000;
    await nextTask();
    return { state: this.#lastState, seconds, stages };
  }

  /**
   * The content of a buffer: its planes one after another, each in whole 32-bit words.
   * @param {string} name
   * @returns {Promise<ArrayBuffer>}
   */
  async read(name) {
    return this.#content(name);
  }

  /**
   * Replace the content of a buffer: its planes one after another, each in whole 32-bit words; the last may be shorter.
   * @param {string} name
   * @param {ArrayBuffer | ArrayBufferView<ArrayBuffer>} content
   */
  write(name, content) {
    const bytes = ArrayBuffer.isView(content)
      ? new Uint8Array(content.buffer, content.byteOffset, content.byteLength)
      : new Uint8Array(content);
    const places = this.#places.get(name) ?? [];
    const size = this.#planeBytes(name);
    for (const [plane, address] of places.entries()) {
      this.#bytes.set(bytes.subarray(plane * size, (plane + 1) * size), address);
    }
  }

  /** End its threads, and release its memory. */
  destroy() {
    for (const other of this.#others) other.terminate();
    this.#others = [];
    this.#program = null;
  }

  /** @param {WebAssembly.Module} module */
  async #start(module) {
    const { exports } = await WebAssembly.instantiate(module, { env: { memory: this.memory } });
    const { run, __stack_pointer, __tls_base } = /** @type {any} */ (exports);
    __stack_pointer.value = stackOf(0);
    __tls_base.value = stackOf(0);
    const starting = [];
    for (let number = 1; number < this.threads; number++) {
      const other = new Worker(new URL("thread.js", import.meta.url), { type: "module" });
      this.#others.push(other);
      starting.push(
        new Promise((resolve, reject) => {
          other.onmessage = resolve;
          other.onerror = (event) => reject(new Error(event.message || "a thread could not be started"));
        }),
      );
      other.postMessage({ module, memory: this.memory, stack: stackOf(number), team: OWN, threads: this.threads });
    }
    await Promise.all(starting);
    this.#program = { run };
  }

  /**
   * A launch as launches.c reads it: a header of four words, then the arguments.
   * @param {Dispatch} dispatch
   * @returns {Uint32Array}
   */
  #launch(dispatch) {
    const kernel = kernelOf(this.plan, dispatch.kernel);
    const items = dispatch.size.reduce((product, size) => product * size, 1);
    const words = [this.plan.kernels.indexOf(kernel), dispatch.size[0], items, 0];
    for (const parameter of kernel.parameters) {
      const value = dispatch.arguments[parameter.name];
      words.push(...(typeof value === "string" ? (this.#places.get(value) ?? []) : argumentWords(parameter, value)));
    }
    return new Uint32Array(words);
  }

  /**
   * @param {string} name
   * @returns {ArrayBuffer}
   */
  #content(name) {
    const size = this.#planeBytes(name);
    const places = this.#places.get(name) ?? [];
    const content = new Uint8Array(places.length * size);
    for (const [plane, address] of places.entries()) {
      content.set(this.#bytes.subarray(address, address + size), plane * size);
    }
    return content.buffer;
  }

  /** @param {string} name */
  #planeBytes(name) {
    const buffer = bufferOf(this.plan, name);
    return bufferBytes(this.plan, buffer) / buffer.planes;
  }

  /**
   * @param {number} address
   * @param {number} length
   */
  #words(address, length) {
    return new Uint32Array(this.#bytes.buffer, address, length);
  }
}

/**
 * A memory of at least so many bytes, all 0.
 * @param {number} bytes
 * @returns {WebAssembly.Memory}
 */
function newMemory(bytes) {
  const pages = Math.ceil(bytes / PAGE);
  try {
    return new WebAssembly.Memory({ initial: pages, maximum: pages, shared: true });
  } catch {
    throw new DoesNotFitError(`it needs a memory of ${(bytes / MIB).toFixed(0)} MiB, which this browser does not give`);
  }
}

/**
 * The first address from ADDRESS on at which something can be placed.
 * @param {number} address
 */
function aligned(address) {
  return Math.ceil(address / ALIGNMENT) * ALIGNMENT;
}

/**
 * Where the stack of thread NUMBER begins, downwards.
 * @param {number} number
 */
function stackOf(number) {
  return OWN + ALIGNMENT + number * (STACK + ALIGNMENT) + STACK;
}

/** Let messages arrive: a frame blocks this thread. */
function nextTask() {
  return new Promise((resolve) => {
    const { port1, port2 } = new MessageChannel();
    port1.onmessage = () => {
      port1.close();
      resolve(undefined);
    };
    port2.postMessage(null);
  });
}
