/**
 * A measuring session in a browser (client_kit/measuring/measurement.py): a check of each configuration, which is its
 * warm-up too, then its runs in the protocol's order.
 */

import {
  Device, DeviceLostError, DoesNotFitError, messageOf, oneLine, requestAdapter,
} from "./gpu-device.js";
import { readFrames, readHeader } from "./pack.js";
import { shade, viewOf } from "./picture.js";
import { nextNumber } from "./plan.js";
import { failedRun, finishedRun, isPlausible, positionsOf } from "./run-record.js";
import { Processor, teams } from "./processor.js";
import { MOST_BLOCKS_REPEATED, plannedRuns, runsOfABlock } from "./schedule.js";
import { mean } from "./speedup.js";
import { deviation } from "./trajectory.js";
import { WasmExecution } from "./wasm.js";
import { Execution } from "./webgpu.js";

const EMPTY_FRAMES = 50;
// Empty frames beside a disturbed run take longer than this over the session's fastest (docs/research/contention.md).
const MOST_SLOWER = 2;
const FRAMES_A_TEAM = 6; // over which a number of threads is timed; the first one fills the caches
const FRAMES_A_PROGRESS = 10;
const LONGEST_PROGRESS_MS = 1000; // on a slow device each frame is reported
const FRAMES_A_PICTURE = 10;
const MOST_LOSSES = 2; // of the device, one after another, until the session ends
const MICROSECONDS = 1e6;

/** @typedef {import("./plan.js").Plan} Plan */
/** @typedef {import("./run-record.js").Run} Run */
/** @typedef {import("./schedule.js").PlannedRun} PlannedRun */
/** @typedef {import("./schedule.js").Protocol} Protocol */
/** @typedef {import("./webgpu.js").Outcome} Outcome */
/** @typedef {import("./webgpu.js").Shaders} Shaders */
/** @typedef {"webgpu" | "wasm"} Backend */
/** @typedef {"device" | "wall" | "none"} StageClock */
/**
 * What all runs of a session share. Only WebAssembly says its threads, and how many the browser claims to have.
 * @typedef {{backend: Backend, threads?: number, threads_claimed?: number, stage_clock: StageClock, empty_frame_us: number}} SessionClock
 */

/**
 * A configuration with what a device needs to run it: WebGPU shaders. `trajectory` is its reference, `band` the largest
 * distance from that (m) at which a device still computes the same.
 * @typedef {object} Configuration
 * @property {string} name
 * @property {number} band
 * @property {Plan} plan
 * @property {Shaders} [shaders]
 * @property {number[][]} trajectory
 */

/**
 * What to measure. `module` holds the kernels of WebAssembly. `header` is the pack's first chunk, `chunks` are the
 * others. `done` are the runs that a resumed session has, and `session` its clocks, null for a new one.
 * @typedef {object} Order
 * @property {Backend} backend
 * @property {ArrayBuffer} [module]
 * @property {Protocol} protocol
 * @property {Configuration[]} configurations
 * @property {ArrayBuffer} header
 * @property {ArrayBuffer[]} chunks
 * @property {Run[]} done
 * @property {SessionClock | null} session
 */

/** @typedef {"compiling" | "preparing" | "checking" | "measuring"} Phase */
/** @typedef {"wrong_results" | "device_lost" | "cannot_resume" | "error"} FailureCode */

/**
 * @typedef {{type: "progress", phase: Phase, configuration: string, run: number, runs: number, frame: number, frames: number}
 *   | {type: "picture", configuration: string, width: number, height: number, pixels: Uint8ClampedArray<ArrayBuffer>}
 *   | {type: "session"} & SessionClock
 *   | {type: "run", run: Run}
 *   | {type: "repeated", replaced: Run[], runs: Run[]}
 *   | {type: "done", interrupted: boolean, disturbed?: true}
 *   | {type: "failed", code: FailureCode, detail: string}} Message
 */

/**
 * Where a session runs. `stored` resolves when the run that was sent last is kept. When `signal` is aborted, the
 * unfinished run is dropped and the session ends. `gpu` is undefined without WebGPU.
 * @typedef {object} Host
 * @property {GPU | undefined} gpu
 * @property {(message: Message, transfer?: Transferable[]) => void} send
 * @property {() => Promise<void>} stored
 * @property {AbortSignal} signal
 */

/** The measurement cannot go on. */
class EndedError extends Error {
  /**
   * @param {FailureCode} code
   * @param {string} detail
   */
  constructor(code, detail) {
    super(detail);
    this.code = code;
  }
}

/** The session was asked to stop. */
class StoppedError extends Error {}

/**
 * Measure ORDER and send its results; the last message is `done` or `failed`.
 *
 * A configuration that does not fit, or that loses the device, is not tried again: its runs fail with that reason
 * and the others go on. If the device's results differ from the reference, nothing is timed.
 * @param {Order} order
 * @param {Host} host
 */
export async function measure(order, host) {
  const runner = new SessionRunner(order, host);
  try {
    await runner.measure();
    host.send({ type: "done", interrupted: false, ...(runner.disturbed && { disturbed: true }) });
  } catch (error) {
    if (error instanceof StoppedError) host.send({ type: "done", interrupted: true });
    else {
      const lost = error instanceof DeviceLostError ? "device_lost" : "error";
      const code = error instanceof EndedError ? error.code : lost;
      host.send({ type: "failed", code, detail: oneLine(messageOf(error)) });
    }
  } finally {
    runner.close();
  }
}

class SessionRunner {
  /** @type {Device | Processor | null} */
  #device = null;
  /** @type {Uint16Array<ArrayBuffer>[]} */
  #images = [];
  /** @type {(number[] | null)[]} */
  #truth = [];
  /** Why a configuration is not tried again, by its name. @type {Map<string, string>} */
  #hopeless = new Map();
  /** Those that ran on the current device. @type {Set<string>} */
  #warm = new Set();
  #losses = 0; // one after another
  /** Empty frames, on the device that they are prepared on.
   * @type {{device: Device | Processor, execution: Execution | WasmExecution} | null} */
  #empty = null;
  /** Microseconds of the empty frames beside each run of this visit, by its id. @type {Map<string, number>} */
  #beside = new Map();
  /** @type {StageClock} */
  #clock;
  #timestampsBelieved = true;
  /** Of WebAssembly. */
  #threads = 1;
  /** Whether other programs disturbed a block after its last try, too. */
  disturbed = false;

  /**
   * @param {Order} order
   * @param {Host} host
   */
  constructor(order, host) {
    this.order = order;
    this.host = host;
    this.frames = order.protocol.frames;
    this.runs = plannedRuns(order.protocol);
    this.left = this.runs.slice(order.done.length);
    this.#threads = order.session?.threads ?? 1; // until they are chosen
    this.#clock = order.session?.stage_clock ?? "device"; // until the check says otherwise
  }

  async measure() {
    await this.#open();
    if (!this.left.length) return;
    await this.#decode();
    await this.#chooseThreads();
    const emptyFrame = this.order.session?.empty_frame_us ?? median(await this.#emptyFrames());
    for (const name of new Set(this.left.map(({ configuration }) => configuration))) await this.#check(name);
    this.#settleClock();
    const { backend } = this.order;
    const threads = this.order.module && { threads: this.#threads, threads_claimed: navigator.hardwareConcurrency };
    this.host.send({ type: "session", backend, ...threads, stage_clock: this.#clock, empty_frame_us: emptyFrame });
    const runs = [...this.order.done];
    for (const planned of this.left) {
      if (planned.order > 0) await this.#rest();
      const run = await this.#run(planned);
      runs.push(run);
      this.host.send({ type: "run", run });
      await this.#unlessStopped(this.host.stored());
      this.#endWithDevice(run);
    }
    await this.#repeat(runs);
  }

  /**
   * Measure the blocks of RUNS again that other programs disturbed.
   * @param {Run[]} runs
   */
  async #repeat(runs) {
    const size = runsOfABlock(this.order.protocol);
    for (let repeated = 0; ; repeated++) {
      const slow = MOST_SLOWER * Math.min(...this.#beside.values());
      const first = runs.findIndex(({ id }) => (this.#beside.get(id) ?? 0) > slow);
      this.disturbed = first >= 0;
      if (!this.disturbed || repeated === MOST_BLOCKS_REPEATED) return;
      const replaced = runs.slice(first - (first % size), first - (first % size) + size);
      let order = Math.max(...runs.map((run) => run.order));
      const again = [];
      for (const { configuration, repeat } of replaced) {
        order += 1;
        await this.#rest();
        again.push(await this.#run({ configuration, repeat, order }));
        this.#endWithDevice(again[again.length - 1]);
      }
      runs = [...runs.filter((run) => !replaced.includes(run)), ...again];
      this.host.send({ type: "repeated", replaced, runs: again });
      await this.#unlessStopped(this.host.stored());
    }
  }

  /**
   * End the session where RUN lost the device once too often.
   * @param {Run} run
   */
  #endWithDevice(run) {
    if (this.#losses >= MOST_LOSSES) throw new EndedError("device_lost", run.failure ?? "");
  }

  /** Release the device. */
  close() {
    this.#empty?.execution.destroy();
    this.#device?.close();
  }

  /**
   * The device, opened on first use and after the last one was lost.
   * @returns {Promise<Device | Processor>}
   */
  async #opened() {
    if (this.#device) return this.#device;
    if (this.order.module) this.#progress("compiling", "", 0, 1);
    this.#device = this.order.module ? await Processor.open(this.order.module, this.#threads) : await this.#gpu();
    this.#warm.clear();
    return this.#device;
  }

  /** @returns {Promise<Device>} */
  async #gpu() {
    const adapter = this.host.gpu && (await requestAdapter(this.host.gpu));
    if (!adapter) throw new EndedError("device_lost", "this browser's WebGPU has no device any more");
    try {
      return await Device.open(adapter);
    } catch (error) {
      throw new EndedError("device_lost", `the device cannot be opened: ${messageOf(error)}`);
    }
  }

  async #open() {
    const { stageClock } = await this.#opened();
    if (stageClock === "device") return;
    if (this.order.session?.stage_clock === "device") {
      throw new EndedError("cannot_resume", "the session began with the device's timestamps, which are missing now");
    }
    this.#clock = stageClock;
  }

  /**
   * PLAN on the device, ready for its first frame.
   * @param {Plan} plan
   * @param {Shaders} [shaders]
   * @param {(done: number, total: number) => void} [compiled]
   * @returns {Promise<Execution | WasmExecution>}
   */
  async #prepared(plan, shaders = {}, compiled = () => {}) {
    const device = await this.#opened();
    if (device instanceof Processor) return WasmExecution.create(device, plan);
    return Execution.create(device, plan, shaders, this.#clock === "device" && plan.dispatches.length > 0, compiled);
  }

  async #decode() {
    const header = await readHeader(this.order.header);
    this.#truth = header.truth.slice(0, this.frames);
    this.#images = await readFrames(header, this.order.chunks, this.frames, (frame) => {
      this.#throwIfStopped();
      this.#progress("preparing", "", frame, this.frames);
    });
  }

  /**
   * Execute WebAssembly by as many threads as compute the first frames of the default fastest. What a browser claims
   * to have is not believed: some have fewer processors, and others are busy. A resumed session keeps its threads.
   */
  async #chooseThreads() {
    const device = await this.#opened();
    if (!(device instanceof Processor)) return;
    let fastest = Infinity;
    for (const threads of this.order.session ? [] : [...teams(), ...teams().reverse()]) {
      device.threads = threads;
      const milliseconds = await this.#millisecondsOfFirstFrames();
      if (milliseconds < fastest) [fastest, this.#threads] = [milliseconds, threads];
    }
    device.threads = this.#threads;
  }

  /** @returns {Promise<number>} the median; infinite where they cannot be computed */
  async #millisecondsOfFirstFrames() {
    try {
      const frames = await this.#frames(this.order.protocol.order[0], FRAMES_A_TEAM, "preparing");
      return 1000 * median(frames.slice(1).map(({ seconds }) => seconds));
    } catch (error) {
      if (error instanceof StoppedError) throw error;
      return Infinity; // no memory for so many threads, or a browser that starts none
    }
  }

  /**
   * The times of empty frames: the image is uploaded and the state is read back.
   * @returns {Promise<number[]>} microseconds of each
   */
  async #emptyFrames() {
    const device = await this.#opened();
    if (this.#empty?.device !== device) {
      this.#empty?.execution.destroy();
      const { plan } = this.order.configurations[0];
      const buffers = plan.buffers.filter(({ name, type }) => name === plan.input || type === "state");
      this.#empty = { device, execution: await this.#prepared({ ...plan, buffers, dispatches: [] }) };
    }
    const times = [];
    for (let frame = 0; frame < EMPTY_FRAMES; frame++) {
      times.push(MICROSECONDS * (await this.#empty.execution.run(frame, this.#images[0])).seconds);
    }
    return times;
  }

  /**
   * Run a configuration over all frames, untimed, and compare it with its reference.
   * @param {string} name
   */
  async #check(name) {
    const { band, trajectory } = this.#configuration(name);
    let frames;
    try {
      frames = await this.#frames(name, this.frames, "checking");
    } catch (error) {
      if (!(error instanceof DoesNotFitError || error instanceof DeviceLostError)) throw error;
      this.#noted(name, error);
      if (this.#losses >= MOST_LOSSES) throw new EndedError("device_lost", error.message);
      return;
    }
    this.#losses = 0;
    const far = deviation(positionsOf(frames), trajectory);
    if (!(far <= band)) {
      const found = Number.isFinite(far) ? `${far.toFixed(6)} m from its reference` : "not finite";
      throw new EndedError("wrong_results", `${name}: the trajectory is ${found}, the band is ${band} m`);
    }
    if (this.#clock === "device" && !isPlausible(frames)) this.#timestampsBelieved = false;
  }

  /** Choose the clock of the stages of all runs. */
  #settleClock() {
    if (this.#clock !== "device" || this.#timestampsBelieved) return;
    if (this.order.session) {
      throw new EndedError("cannot_resume", "the device's timestamps measured this session, and are wrong now");
    }
    this.#clock = "none";
  }

  /**
   * Measure one run.
   * @param {PlannedRun} planned
   * @returns {Promise<Run>}
   */
  async #run(planned) {
    const { configuration: name, order } = planned;
    const timed = this.#clock !== "none";
    const hopeless = this.#hopeless.get(name);
    if (hopeless !== undefined) return failedRun(planned, hopeless, timed);
    const { plan, trajectory } = this.#configuration(name);
    try {
      const device = await this.#opened();
      if (this.#clock === "device" && device.stageClock !== "device") {
        throw new EndedError("device_lost", "the device was lost, and the one in its place has no timestamps");
      }
      if (!this.#warm.has(name)) await this.#frames(name, this.order.protocol.warmup_frames, "checking", order);
      const before = mean(await this.#emptyFrames());
      const frames = await this.#frames(name, this.frames, "measuring", order);
      const after = mean(await this.#emptyFrames());
      this.#losses = 0;
      const run = finishedRun(planned, plan, frames, { trajectory, truth: this.#truth }, timed);
      this.#beside.set(run.id, Math.max(before, after));
      return run;
    } catch (error) {
      if (error instanceof StoppedError || error instanceof EndedError) throw error;
      this.#noted(name, error);
      return failedRun(planned, oneLine(messageOf(error)), timed);
    }
  }

  /**
   * Run a configuration over the first COUNT frames. Pictures are drawn between frames that are not timed, and
   * at the end.
   * @param {string} name
   * @param {number} count
   * @param {Phase} phase
   * @param {number} [order] of the run
   * @returns {Promise<Outcome[]>}
   */
  async #frames(name, count, phase, order) {
    const { plan, shaders } = this.#configuration(name);
    const execution = await this.#prepared(plan, shaders, (done, total) => {
      if (phase === "checking") this.#progress("compiling", name, done, total, order);
    });
    this.#progress(phase, name, 0, count, order);
    let reported = performance.now();
    try {
      /** @type {Outcome[]} */
      const frames = [];
      let number = 0; // of the frame in the plan
      for (const image of this.#images.slice(0, count)) {
        this.#throwIfStopped();
        const frame = await execution.run(number, image);
        number = nextNumber(number, frame.state);
        frames.push(frame);
        const done = frames.length;
        const late = performance.now() - reported > LONGEST_PROGRESS_MS;
        if (done % FRAMES_A_PROGRESS === 0 || done === count || late) {
          this.#progress(phase, name, done, count, order);
          reported = performance.now();
        }
        const shown = phase === "checking" && done % FRAMES_A_PICTURE === 0;
        if (shown || (done === count && phase !== "preparing")) {
          await this.#picture(name, execution, frame);
        }
      }
      this.#warm.add(name);
      return frames;
    } finally {
      execution.destroy();
    }
  }

  /**
   * Handle an ERROR: whether the configuration is tried again, and on which device.
   * @param {string} name
   * @param {unknown} error
   */
  #noted(name, error) {
    if (error instanceof DoesNotFitError || error instanceof DeviceLostError) {
      this.#hopeless.set(name, error.message);
    }
    if (error instanceof DoesNotFitError) return;
    if (error instanceof DeviceLostError) this.#losses += 1;
    // After another error the device's results cannot be trusted.
    this.#device?.close();
    this.#device = null;
  }

  /**
   * Send the shaded model of the last frame.
   * @param {string} configuration
   * @param {Execution | WasmExecution} execution
   * @param {Outcome} frame
   */
  async #picture(configuration, execution, { state }) {
    const view = viewOf(execution.plan);
    if (!view) return;
    const vertices = new Float32Array(await execution.read(view.vertices));
    const normals = new Float32Array(await execution.read(view.normals));
    const pose = /** @type {Float32Array} */ (state.pose);
    const pixels = shade(vertices, normals, [pose[3], pose[7], pose[11]]);
    const { width, height } = view;
    this.host.send({ type: "picture", configuration, width, height, pixels }, [pixels.buffer]);
  }

  /**
   * @param {Phase} phase
   * @param {string} configuration
   * @param {number} frame
   * @param {number} frames
   * @param {number} [order] of the run
   */
  #progress(phase, configuration, frame, frames, order) {
    const run = order === undefined ? 0 : order + 1;
    this.host.send({ type: "progress", phase, configuration, run, runs: this.runs.length, frame, frames });
  }

  /**
   * @param {string} name
   * @returns {Configuration}
   */
  #configuration(name) {
    const found = this.order.configurations.find((configuration) => configuration.name === name);
    if (!found) throw new Error(`the protocol names the configuration ${name}, which the front does not have`);
    return found;
  }

  /** Let the device rest between two runs, as the protocol says. */
  async #rest() {
    const seconds = this.order.protocol.rest_seconds;
    if (seconds > 0) await this.#unlessStopped(new Promise((resolve) => setTimeout(resolve, 1000 * seconds)));
  }

  #throwIfStopped() {
    if (this.host.signal.aborted) throw new StoppedError();
  }

  /**
   * Wait for WORK, or until the session is asked to stop.
   * @param {Promise<unknown>} work
   */
  async #unlessStopped(work) {
    const { signal } = this.host;
    this.#throwIfStopped();
    let stop = () => {};
    const stopped = new Promise((resolve) => {
      stop = () => resolve(undefined);
      signal.addEventListener("abort", stop);
    });
    await Promise.race([work, stopped]);
    signal.removeEventListener("abort", stop);
    this.#throwIfStopped();
  }
}

/**
 * @param {number[]} values
 * @returns {number}
 */
function median(values) {
  const sorted = [...values].sort((a, b) => a - b);
  const half = sorted.length / 2;
  return (sorted[Math.ceil(half) - 1] + sorted[Math.floor(half)]) / 2;
}
