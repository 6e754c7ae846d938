/** The execution of a plan on a WebGPU device (slam/plans/webgpu.py). */

import { DoesNotFitError, ShaderError } from "./gpu-device.js";
import {
  bufferBytes, bufferOf, checkPlan, groupsOf, idleStages, initialState, kernelOf, packedUniforms, readState, segmentsOf,
  servedState, stateBuffer, stateBytes, takesPlace,
} from "./plan.js";
import { StageClock } from "./stage-clock.js";

const MIB = 2 ** 20;
const ALIGNMENT = 256; // of a part of a uniform buffer

/** @typedef {import("./gpu-device.js").Device} Device */
/** @typedef {import("./plan.js").Plan} Plan */
/** @typedef {import("./plan.js").Kernel} Kernel */
/** @typedef {import("./plan.js").Dispatch} Dispatch */
/** @typedef {import("./plan.js").State} State */
/** @typedef {Record<string, string>} Shaders WGSL text by the kernel's name */

/**
 * The outcome of one frame: the state after it, the wall seconds from before the upload until the state was read
 * back, and the device's seconds by stage, null where no timestamps are taken. A skipped one was not computed.
 * @typedef {{state: State, seconds: number, stages: Record<string, number> | null, skipped?: boolean}} Outcome
 */

/** A launch, ready to be encoded. @typedef {{pipeline: GPUComputePipeline, bindings: GPUBindGroup, groups: number[]}} Launch */

/** A plan on a device, ready for its first frame. */
export class Execution {
  /** @type {Device} */
  #device;
  /** @type {Map<string, GPUBuffer>} */
  #buffers = new Map();
  /** @type {GPUBuffer[]} */
  #others = []; // to be destroyed, too
  /** @type {{stage: string, first: Dispatch, launches: Launch[]}[]} */
  #segments = [];
  /** @type {StageClock | null} */
  #clock = null;
  /** @type {GPUBuffer | null} */
  #readback = null;
  /** @type {GPUBuffer | null} */
  #state = null;
  /** @type {GPUBuffer | null} */
  #input = null;
  #stateBytes = 0;
  /** @type {State} */
  #lastState = {}; // as last read
  #served = 0; // frames that were left out since

  /**
   * @param {Device} device
   * @param {Plan} plan
   */
  constructor(device, plan) {
    this.#device = device;
    this.plan = plan;
  }

  /**
   * Prepare PLAN on DEVICE. With `timed`, each frame's stages are measured by the device's timestamps. `compiled` is
   * called with the numbers of kernels that are compiled, and of all.
   * @param {Device} device
   * @param {Plan} plan
   * @param {Shaders} shaders
   * @param {boolean} [timed]
   * @param {(done: number, total: number) => void} [compiled]
   * @returns {Promise<Execution>}
   * @throws {DoesNotFitError} where a buffer is too large, naming the MiB that are needed and allowed
   * @throws {ShaderError} where the device refuses a kernel
   * @throws {DeviceLostError}
   */
  static async create(device, plan, shaders, timed = false, compiled = () => {}) {
    checkPlan(plan, "pixels");
    checkFits(device, plan);
    const execution = new Execution(device, plan);
    try {
      await execution.#prepare(shaders, timed, compiled);
    } catch (error) {
      execution.destroy();
      throw error;
    }
    return execution;
  }

  /**
   * Launch what takes place in frame NUMBER over IMAGE, in one submission, and wait for the state.
   * @param {number} number
   * @param {Uint16Array<ArrayBuffer> | null} image millimetres; null keeps the last one
   * @returns {Promise<Outcome>}
   */
  async run(number, image) {
    const gpu = this.#device.gpu;
    const readback = present(this.#readback);
    const began = performance.now();
    const served = servedState(this.plan, this.#lastState, this.#served);
    if (served) {
      this.#served += 1;
      const seconds = (performance.now() - began) / 1000;
      return { state: served, seconds, stages: this.#clock ? idleStages(this.plan) : null, skipped: true };
    }
    this.#served = 0;
    if (image) gpu.queue.writeBuffer(present(this.#input), 0, wholeWords(image));
    const encoder = gpu.createCommandEncoder();
    const taking = this.#segments.filter(({ first }) => takesPlace(first, number, this.#lastState));
    if (this.#clock) {
      for (const [index, { launches }] of taking.entries()) {
        encode(encoder, launches, { timestampWrites: this.#clock.writes(index) });
      }
    } else {
      encode(encoder, taking.flatMap(({ launches }) => launches), {});
    }
    encoder.copyBufferToBuffer(present(this.#state), 0, readback, 0, this.#stateBytes);
    this.#clock?.resolve(encoder, taking.length, readback);
    gpu.queue.submit([encoder.finish()]);
    await this.#device.guarded(readback.mapAsync(GPUMapMode.READ));
    const data = readback.getMappedRange().slice(0);
    const seconds = (performance.now() - began) / 1000;
    readback.unmap();
    this.#lastState = readState(this.plan, data);
    return {
      state: this.#lastState,
      seconds,
      stages: this.#clock ? this.#clock.stages(data, taking) : null,
    };
  }

  /**
   * The content of a buffer: its planes one after another, each in whole 32-bit words.
   * @param {string} name
   * @returns {Promise<ArrayBuffer>}
   */
  async read(name) {
    const bytes = bufferBytes(this.plan, bufferOf(this.plan, name));
    const gpu = this.#device.gpu;
    const target = gpu.createBuffer({ size: bytes, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
    try {
      const encoder = gpu.createCommandEncoder();
      encoder.copyBufferToBuffer(present(this.#buffers.get(name)), 0, target, 0, bytes);
      gpu.queue.submit([encoder.finish()]);
      await this.#device.guarded(target.mapAsync(GPUMapMode.READ));
      return target.getMappedRange().slice(0);
    } finally {
      target.destroy();
    }
  }

  /**
   * Replace the content of a buffer: its planes one after another, each in whole 32-bit words.
   * @param {string} name
   * @param {BufferSource} content
   */
  write(name, content) {
    this.#device.gpu.queue.writeBuffer(present(this.#buffers.get(name)), 0, content);
  }

  /** Release its memory. */
  destroy() {
    for (const buffer of [...this.#buffers.values(), ...this.#others]) buffer.destroy();
    this.#clock?.destroy();
    this.#buffers.clear();
    this.#others = [];
  }

  /**
   * @param {Shaders} shaders
   * @param {boolean} timed
   * @param {(done: number, total: number) => void} compiled
   */
  async #prepare(shaders, timed, compiled) {
    const { STORAGE, COPY_SRC, COPY_DST, MAP_READ } = GPUBufferUsage;
    for (const buffer of this.plan.buffers) {
      const size = bufferBytes(this.plan, buffer);
      const what = `the buffer ${buffer.name} of ${mebibytes(size)} MiB`;
      const made = await this.#device.created(what, () =>
        this.#device.gpu.createBuffer({ label: buffer.name, size, usage: STORAGE | COPY_SRC | COPY_DST }),
      );
      this.#buffers.set(buffer.name, made);
    }
    this.#stateBytes = stateBytes(this.plan);
    this.#state = present(this.#buffers.get(stateBuffer(this.plan).name));
    this.#input = this.#buffers.get(this.plan.input) ?? null;
    const initial = initialState(this.plan);
    this.#lastState = readState(this.plan, initial);
    this.#device.gpu.queue.writeBuffer(this.#state, 0, initial);
    const segments = segmentsOf(this.plan);
    if (timed) this.#clock = await StageClock.create(this.#device, this.plan, segments.length, this.#stateBytes);
    const size = this.#clock ? this.#clock.readbackBytes : this.#stateBytes;
    this.#readback = await this.#device.created("memory to read back", () =>
      this.#device.gpu.createBuffer({ size, usage: MAP_READ | COPY_DST }),
    );
    this.#others.push(this.#readback);
    const launches = await this.#bound(await this.#pipelines(shaders, compiled));
    for (const { stage, dispatches } of segments) {
      this.#segments.push({ stage, first: dispatches[0], launches: launches.splice(0, dispatches.length) });
    }
  }

  /**
   * The compiled kernels by name.
   * @param {Shaders} shaders
   * @param {(done: number, total: number) => void} compiled
   * @returns {Promise<Map<string, GPUComputePipeline>>}
   */
  async #pipelines(shaders, compiled) {
    const names = [...new Set(this.plan.dispatches.map(({ kernel }) => kernel))];
    /** @type {Map<string, GPUComputePipeline>} */
    const pipelines = new Map();
    await Promise.all(
      names.map(async (name) => {
        if (!shaders[name]) throw new ShaderError(`the kernel ${name} has no shader`);
        const kinds = kindsOf(kernelOf(this.plan, name));
        pipelines.set(name, await this.#device.pipeline(name, shaders[name], kinds));
        compiled(pipelines.size, names.length);
      }),
    );
    return pipelines;
  }

  /**
   * Every dispatch with its pipeline and its bindings, in their order.
   * @param {Map<string, GPUComputePipeline>} pipelines
   * @returns {Promise<Launch[]>}
   */
  async #bound(pipelines) {
    const { dispatches } = this.plan;
    const parts = dispatches.map((dispatch) => packedUniforms(kernelOf(this.plan, dispatch.kernel), dispatch));
    const places = await this.#uniforms(parts);
    return this.#device.created("the bindings of the kernels", () =>
      dispatches.map((dispatch, index) => {
        const storage = kernelOf(this.plan, dispatch.kernel).parameters.filter(({ access }) => access !== null);
        /** @type {GPUBufferBinding[]} */
        const resources = storage.map(({ name }) => ({
          buffer: present(this.#buffers.get(String(dispatch.arguments[name]))),
        }));
        const place = places[index];
        const pipeline = present(pipelines.get(dispatch.kernel));
        if (place) resources.push(place);
        const bindings = this.#device.gpu.createBindGroup({
          layout: pipeline.getBindGroupLayout(0),
          entries: resources.map((resource, binding) => ({ binding, resource })),
        });
        return { pipeline, bindings, groups: groupsOf(dispatch) };
      }),
    );
  }

  /**
   * PARTS in one uniform buffer, equal ones once; null for an empty part.
   * @param {Uint8Array<ArrayBuffer>[]} parts
   * @returns {Promise<(GPUBufferBinding | null)[]>}
   */
  async #uniforms(parts) {
    const distinct = new Map(parts.filter((part) => part.length).map((part) => [String(part), part]));
    if (!distinct.size) return parts.map(() => null);
    const offsets = new Map();
    let size = 0;
    for (const [key, part] of distinct) {
      offsets.set(key, size);
      size += Math.ceil(part.length / ALIGNMENT) * ALIGNMENT;
    }
    const usage = GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST;
    const buffer = await this.#device.created("the parameters of the kernels", () =>
      this.#device.gpu.createBuffer({ size, usage }),
    );
    this.#others.push(buffer);
    for (const [key, part] of distinct) this.#device.gpu.queue.writeBuffer(buffer, offsets.get(key), part);
    return parts.map((part) =>
      part.length ? { buffer, offset: offsets.get(String(part)), size: part.length } : null,
    );
  }
}

/**
 * @param {Device} device
 * @param {Plan} plan
 * @throws {DoesNotFitError} where a buffer is larger than the device allows
 */
function checkFits(device, plan) {
  const filled = plan.buffers.filter((buffer) => buffer.fill).map((buffer) => buffer.name);
  if (filled.length) throw new Error(`buffers ${filled.join(", ")}: WebGPU fills new memory with 0 only`);
  for (const buffer of plan.buffers) {
    const bytes = bufferBytes(plan, buffer);
    if (bytes > device.maxAllocation) {
      throw new DoesNotFitError(
        `the buffer ${buffer.name} needs one buffer of ${mebibytes(bytes)} MiB, ` +
          `'${device.name}' allows at most ${mebibytes(device.maxAllocation)} MiB`,
      );
    }
  }
}

/**
 * The kinds of a kernel's bindings, in their order: its buffers, then its other parameters.
 * @param {Kernel} kernel
 * @returns {GPUBufferBindingType[]}
 */
function kindsOf(kernel) {
  const storage = kernel.parameters.filter(({ access }) => access !== null);
  /** @type {GPUBufferBindingType[]} */
  const kinds = storage.map(({ access }) => (access === "read" ? "read-only-storage" : "storage"));
  if (storage.length < kernel.parameters.length) kinds.push("uniform");
  return kinds;
}

/**
 * @param {GPUCommandEncoder} encoder
 * @param {Launch[]} launches
 * @param {GPUComputePassDescriptor} description
 */
function encode(encoder, launches, description) {
  const pass = encoder.beginComputePass(description);
  for (const { pipeline, bindings, groups } of launches) {
    pass.setPipeline(pipeline);
    pass.setBindGroup(0, bindings);
    pass.dispatchWorkgroups(groups[0], groups[1], groups[2]);
  }
  pass.end();
}

/**
 * IMAGE, padded with a 0 to whole 32-bit words.
 * @param {Uint16Array<ArrayBuffer>} image
 * @returns {Uint16Array<ArrayBuffer>}
 */
function wholeWords(image) {
  if (image.length % 2 === 0) return image;
  const whole = new Uint16Array(image.length + 1);
  whole.set(image);
  return whole;
}

/**
 * @param {number} bytes
 * @returns {string}
 */
function mebibytes(bytes) {
  return (bytes / MIB).toFixed(bytes < MIB ? 3 : 0);
}

/**
 * @template T
 * @param {T | null | undefined} value
 * @returns {T}
 */
function present(value) {
  if (value === null || value === undefined) throw new Error("the plan names a buffer that it does not have");
  return value;
}
