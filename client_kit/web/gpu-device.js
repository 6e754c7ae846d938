/** A WebGPU device with default limits, its errors, and its compiled pipelines. */

const LOSS_KNOWN_WITHIN_MS = 500; // between a call that fails for a lost device and the news of the loss

/**
 * The description of an adapter; "" where unknown.
 * @typedef {object} AdapterInfo
 * @property {string} vendor
 * @property {string} architecture
 * @property {string} device
 * @property {string} description
 * @property {boolean} fallback whether it is software
 */

/** A plan needs more memory than the device allows. */
export class DoesNotFitError extends Error {}

/** The browser or its driver took the device away; it cannot compute any more. */
export class DeviceLostError extends Error {}

/** The device refused a kernel's text. */
export class ShaderError extends Error {}

/**
 * The adapter to measure on: the fastest one, else one in compatibility mode.
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
    /** Of the stages: its own, where it can take the times of compute passes. @type {"device" | "none"} */
    this.stageClock = gpu.features.has("timestamp-query") ? "device" : "none";
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

  /** Give it back to the browser. */
  close() {
    this.gpu.destroy();
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
   * Do CREATE, which makes WHAT on the device, and report its errors.
   * @template T
   * @param {string} what
   * @param {() => T} create
   * @returns {Promise<T>}
   * @throws {DoesNotFitError} if it does not fit into memory
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
   * ERROR, or the loss of the device if that caused it.
   * @param {unknown} error
   * @returns {Promise<unknown>}
   */
  async #explained(error) {
    if (error instanceof DeviceLostError) return error;
    const nothing = new Promise((resolve) => setTimeout(resolve, LOSS_KNOWN_WITHIN_MS, error));
    return Promise.race([nothing, this.lost]).catch((loss) => loss);
  }
}

/**
 * TEXT as one line of limited length, for sending.
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
