/** A WebGPU device with default limits, and the execution of a plan on it (slam/plans/webgpu.py). */

import {
  bufferBytes, bufferOf, checkPlan, groupsOf, initialState, kernelOf, packedUniforms, readState, segmentsOf,
  stagesOf, stateBuffer, stateBytes, takesPlace,
} from "./plan.js";

const MIB = 2 ** 20;
const ALIGNMENT = 256; // of a part of a uniform buffer
const LOSS_KNOWN_WITHIN_MS = 500; // between a call that fails for a lost device and the news of the loss

/** @typedef {import("./plan.js").Plan} Plan */
/** @typedef {import("./plan.js").Kernel} Kernel */
/** @typedef {import("./plan.js").Dispatch} Dispatch */
/** @typedef {import("./plan.js").State} State */
/** @typedef {Record<string, string>} Shaders WGSL text by the kernel's name */

/**
 * What came of one frame: the state after it, the wall seconds from before the upload until the state was read
 * back, and the device's seconds by stage, null where no timestamps are taken.
 * @typedef {{state: State, seconds: number, stages: Record<string, number> | null}} Outcome
 */

/**
 * What an adapter tells of itself; "" where it tells nothing.
 * @typedef {object} AdapterInfo
 * @property {string} vendor
 * @property {string} architecture
 * @property {string} device
 * @property {string} description
 * @property {boolean} fallback whether it is software
 */

/** A launch, ready to be encoded. @typedef {{pipeline: GPUComputePipeline, bindings: GPUBindGroup, groups: number[]}} Launch */

/** A plan needs more memory than the device has or allows. */
export class DoesNotFitError extends Error {}

/** The browser or its driver took the device away; nothing can be computed on it any more. */
export class DeviceLostError extends Error {}

/** The device refused a kernel's text. */
export class ShaderError extends Error {}

/**
 * The adapter to measure on: the fastest, and one for compatibility mode where there is no other.
 * @param {GPU} gpu
 * @returns {Promise<GPUAdapter | null>}
 */
export async function requestAdapter(gpu) {
  /** @type {GPURequestAdapterOptions} */
  const options = { powerPreference: "high-performance" };
  return (
    (await gpu.requestAdapter(options)) ??
    (await gpu.requestAdapter({ ...options, featureLevel: "compatibility" }))
  );
}

/**
 * @param {GPUAdapter} adapter
 * @returns {AdapterInfo}
 */
export function describeAdapter({ info }) {
  return {
    vendor: info.vendor ?? "",
    architecture: info.architecture ?? "",
    device: info.device ?? "",
    description: info.description ?? "",
    fallback: info.isFallbackAdapter ?? false,
  };
}

/** A device with the default limits, and the pipelines that were compiled on it. */
export class Device {
  /** @type {Map<string, Promise<GPUComputePipeline>>} */
  #pipelines = new Map();
  /** @type {string | null} */
  #refusal = null;

  /**
   * @param {GPUDevice} gpu
   * @param {string} name for messages
   */
  constructor(gpu, name) {
    this.gpu = gpu;
    this.name = name;
    /** Whether it can take the times of compute passes. */
    this.timestamps = gpu.features.has("timestamp-query");
    /** Rejects with a DeviceLostError when the device is lost. @type {Promise<never>} */
    this.lost = gpu.lost.then(({ message, reason }) => {
      throw new DeviceLostError(oneLine(`the device was lost (${reason}): ${message || "no reason given"}`));
    });
    this.lost.catch(() => {}); // `guarded` reports it
    gpu.addEventListener("uncapturederror", (event) => {
      this.#refusal ??= oneLine(event.error.message);
    });
  }

  /**
   * Open ADAPTER's device with no optional feature but timestamps.
   * @param {GPUAdapter} adapter
   * @returns {Promise<Device>}
   */
  static async open(adapter) {
    /** @type {GPUFeatureName[]} */
    const features = adapter.features.has("timestamp-query") ? ["timestamp-query"] : [];
    const info = describeAdapter(adapter);
    const name = info.description || info.device || `${info.vendor} ${info.architecture}`.trim();
    return new Device(await adapter.requestDevice({ requiredFeatures: features }), name || "this device");
  }

  /** The largest buffer, in bytes, that a kernel may use. */
  get maxAllocation() {
    return Math.min(this.gpu.limits.maxStorageBufferBindingSize, this.gpu.limits.maxBufferSize);
  }

  /**
   * The result of WORK, or a DeviceLostError when the device is lost meanwhile.
   * @template T
   * @param {Promise<T>} work
   * @returns {Promise<T>}
   */
  async guarded(work) {
    let result;
    try {
      result = await Promise.race([work, this.lost]);
    } catch (error) {
      throw await this.#explained(error);
    }
    if (this.#refusal !== null) throw new Error(`${this.name} refused the work: ${this.#refusal}`);
    return result;
  }

  /**
   * Do CREATE, which makes WHAT on the device, and report what is wrong with it.
   * @template T
   * @param {string} what
   * @param {() => T} create
   * @returns {Promise<T>}
   * @throws {DoesNotFitError} where there is no memory for it
   */
  async created(what, create) {
    this.gpu.pushErrorScope("validation");
    this.gpu.pushErrorScope("out-of-memory");
    /** @type {T} */
    let made;
    let memory;
    let refusal;
    try {
      made = create();
    } finally {
      memory = this.gpu.popErrorScope();
      refusal = this.gpu.popErrorScope();
    }
    const [noMemory, invalid] = await this.guarded(Promise.all([memory, refusal]));
    if (noMemory) throw new DoesNotFitError(`${what}: '${this.name}' has no memory left for it`);
    if (invalid) throw new Error(oneLine(`'${this.name}' refused ${what}: ${invalid.message}`));
    return made;
  }

  /**
   * The kernel NAME of the WGSL TEXT, compiled on first use.
   * @param {string} name
   * @param {string} text
   * @param {GPUBufferBindingType[]} kinds of its bindings
   * @returns {Promise<GPUComputePipeline>}
   * @throws {ShaderError} where the device refuses it
   */
  pipeline(name, text, kinds) {
    const key = JSON.stringify([name, kinds, text]);
    const found = this.#pipelines.get(key) ?? this.#compiled(name, text, kinds);
    this.#pipelines.set(key, found);
    return found;
  }

  /**
   * @param {string} name
   * @param {string} text
   * @param {GPUBufferBindingType[]} kinds
   * @returns {Promise<GPUComputePipeline>}
   */
  async #compiled(name, text, kinds) {
    const entries = kinds.map((type, binding) => ({
      binding,
      visibility: GPUShaderStage.COMPUTE,
      buffer: { type },
    }));
    this.gpu.pushErrorScope("validation");
    const module = this.gpu.createShaderModule({ label: name, code: text });
    const layout = this.gpu.createPipelineLayout({
      bindGroupLayouts: [this.gpu.createBindGroupLayout({ entries })],
    });
    const refusal = this.gpu.popErrorScope();
    const compute = { module, entryPoint: name };
    const compiled = this.gpu.createComputePipelineAsync({ label: name, layout, compute });
    try {
      const [pipeline, invalid] = await this.guarded(Promise.all([compiled, refusal]));
      if (invalid) throw new Error(invalid.message);
      return pipeline;
    } catch (error) {
      if (error instanceof DeviceLostError) throw error;
      const { messages } = await module.getCompilationInfo();
      const first = messages.find((message) => message.type === "error");
      const reason = first ? `line ${first.lineNum}: ${first.message}` : messageOf(error);
      throw new ShaderError(oneLine(`'${this.name}' refused the kernel ${name}: ${reason}`));
    }
  }

  /**
   * ERROR, or the loss of the device where that is what it comes from.
   * @param {unknown} error
   * @returns {Promise<unknown>}
   */
  async #explained(error) {
    if (error instanceof DeviceLostError) return error;
    const nothing = new Promise((resolve) => setTimeout(resolve, LOSS_KNOWN_WITHIN_MS, error));
    return Promise.race([nothing, this.lost]).catch((loss) => loss);
  }
}

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
  /** @type {Clock | null} */
  #clock = null;
  /** @type {GPUBuffer | null} */
  #readback = null;
  /** @type {GPUBuffer | null} */
  #state = null;
  /** @type {GPUBuffer | null} */
  #input = null;
  #stateBytes = 0;

  /**
   * @param {Device} device
   * @param {Plan} plan
   */
  constructor(device, plan) {
    this.#device = device;
    this.plan = plan;
  }

  /**
   * Prepare PLAN on DEVICE. With `timed`, each frame's stages are measured by the device's timestamps.
   * @param {Device} device
   * @param {Plan} plan
   * @param {Shaders} shaders
   * @param {boolean} [timed]
   * @returns {Promise<Execution>}
   * @throws {DoesNotFitError} where a buffer is too large, naming the MiB that are needed and allowed
   * @throws {ShaderError} where the device refuses a kernel
   * @throws {DeviceLostError}
   */
  static async create(device, plan, shaders, timed = false) {
    checkPlan(plan);
    checkFits(device, plan);
    const execution = new Execution(device, plan);
    try {
      await execution.#prepare(shaders, timed);
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
    if (image) gpu.queue.writeBuffer(present(this.#input), 0, wholeWords(image));
    const encoder = gpu.createCommandEncoder();
    const taking = this.#segments.filter(({ first }) => takesPlace(first, number));
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
    return {
      state: readState(this.plan, data),
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

  /** Give its memory back. */
  destroy() {
    for (const buffer of [...this.#buffers.values(), ...this.#others]) buffer.destroy();
    this.#clock?.destroy();
    this.#buffers.clear();
    this.#others = [];
  }

  /**
   * @param {Shaders} shaders
   * @param {boolean} timed
   */
  async #prepare(shaders, timed) {
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
    this.#device.gpu.queue.writeBuffer(this.#state, 0, initialState(this.plan));
    const segments = segmentsOf(this.plan);
    if (timed) this.#clock = await Clock.create(this.#device, this.plan, segments.length, this.#stateBytes);
    const size = this.#clock ? this.#clock.readbackBytes : this.#stateBytes;
    this.#readback = await this.#device.created("memory to read back", () =>
      this.#device.gpu.createBuffer({ size, usage: MAP_READ | COPY_DST }),
    );
    this.#others.push(this.#readback);
    const launches = await this.#bound(shaders);
    for (const { stage, dispatches } of segments) {
      this.#segments.push({ stage, first: dispatches[0], launches: launches.splice(0, dispatches.length) });
    }
  }

  /**
   * Every dispatch with its pipeline and its bindings, in their order.
   * @param {Shaders} shaders
   * @returns {Promise<Launch[]>}
   */
  async #bound(shaders) {
    const { dispatches } = this.plan;
    const parts = dispatches.map((dispatch) => packedUniforms(kernelOf(this.plan, dispatch.kernel), dispatch));
    const places = await this.#uniforms(parts);
    const pipelines = await Promise.all(
      dispatches.map(({ kernel: name }) => {
        if (!shaders[name]) throw new ShaderError(`there is no shader of the kernel ${name}`);
        return this.#device.pipeline(name, shaders[name], kindsOf(kernelOf(this.plan, name)));
      }),
    );
    return this.#device.created("the bindings of the kernels", () =>
      dispatches.map((dispatch, index) => {
        const storage = kernelOf(this.plan, dispatch.kernel).parameters.filter(({ access }) => access !== null);
        /** @type {GPUBufferBinding[]} */
        const resources = storage.map(({ name }) => ({
          buffer: present(this.#buffers.get(String(dispatch.arguments[name]))),
        }));
        const place = places[index];
        if (place) resources.push(place);
        const bindings = this.#device.gpu.createBindGroup({
          layout: pipelines[index].getBindGroupLayout(0),
          entries: resources.map((resource, binding) => ({ binding, resource })),
        });
        return { pipeline: pipelines[index], bindings, groups: groupsOf(dispatch) };
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

/** The timestamps of a frame's passes, read back behind the state. */
class Clock {
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
   * @returns {Promise<Clock>}
   */
  static async create(device, plan, passes, stateBytes) {
    const count = 2 * Math.max(passes, 1);
    const { QUERY_RESOLVE, COPY_SRC } = GPUBufferUsage;
    return device.created("timestamps", () => {
      const queries = device.gpu.createQuerySet({ type: "timestamp", count });
      const resolved = device.gpu.createBuffer({ size: 8 * count, usage: QUERY_RESOLVE | COPY_SRC });
      return new Clock(queries, resolved, stagesOf(plan), Math.ceil(stateBytes / 8) * 8);
    });
  }

  /**
   * Where pass INDEX of a frame writes its times.
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
   * Copy the times of a frame's passes behind the state.
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
   * Passes overlap on tiled GPUs, so that their sum says less.
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

/**
 * @param {Device} device
 * @param {Plan} plan
 * @throws {DoesNotFitError} where a buffer is larger than the device allows
 */
function checkFits(device, plan) {
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
 * IMAGE, with a 0 behind it where it does not fill whole 32-bit words.
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
 * TEXT in one line of a length that is fit to be sent.
 * @param {string} text
 * @returns {string}
 */
export function oneLine(text) {
  return text.replace(/[\s\p{C}]+/gu, " ").trim().slice(0, 300);
}

/**
 * @param {unknown} error
 * @returns {string}
 */
export function messageOf(error) {
  return error instanceof Error ? error.message : String(error);
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
