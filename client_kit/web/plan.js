/**
 * The plan of a frame as data (slam/plans/plan.py, described by slam/plans/schema.json), without a device: the steps of
 * a frame, and the memory layout of the state, the buffers and the kernels' parameters.
 */

const VERSIONS = [1, 2]; // plans of version 2 leave out frames
const STATE = "state"; // the type of the one buffer that holds what tracking keeps between frames
/** @type {Record<string, number>} */
const BYTES = { f32: 4, i32: 4, u32: 4, u16: 2, u8: 1, vec4f: 16 };

/** @typedef {{name: string, type: string, count: number}} Member */
/** @typedef {{name: string, type: string, count: number, planes: number, fill: number}} Buffer */
/** @typedef {{name: string, type: string, access: "read" | "write" | "atomic" | null, planes: number}} Parameter */
/** @typedef {{name: string, source: string, parameters: Parameter[]}} Kernel */
/** Members of the state that skip frames. @typedef {{count: string, poses: string, pose: string}} Skipping */
/** @typedef {{first: number, last: number | null, every: number, after: string | null}} Frames */

/**
 * @typedef {object} Dispatch
 * @property {string} kernel
 * @property {string} stage
 * @property {number[]} size in work-items
 * @property {number[]} group
 * @property {Record<string, string | number | number[]>} arguments
 * @property {Frames[]} frames
 * @property {string | null} flag
 */

/**
 * @typedef {object} Plan
 * @property {number} version
 * @property {string} system
 * @property {string} layout
 * @property {Record<string, number>} configuration
 * @property {Member[]} state
 * @property {Record<string, number[]>} initial
 * @property {Buffer[]} buffers
 * @property {Kernel[]} kernels
 * @property {Dispatch[]} dispatches
 * @property {string} input the buffer that takes each frame's depth image
 * @property {Skipping} [skipping] absent where every frame is computed
 */

/**
 * Dispatches of one stage, one after another, that take place in the same frames.
 * @typedef {{stage: string, dispatches: Dispatch[]}} Segment
 */

/**
 * The values of the state by the members' names, a number for each member of count 1.
 * @typedef {Record<string, number | Float32Array | Int32Array | Uint32Array>} State
 */

/**
 * Reject plans that this program cannot execute.
 * @param {Plan} plan
 * @param {"pixels" | "rows"} layout that an executor needs
 * @throws {Error} for another version or layout
 */
export function checkPlan(plan, layout) {
  if (!VERSIONS.includes(plan.version)) {
    throw new Error(`a plan of version ${plan.version}: this program reads ${VERSIONS.join(" and ")}`);
  }
  if (plan.layout !== layout) throw new Error(`a plan laid out by ${plan.layout}, where ${layout} are executed`);
}

/**
 * Whether a dispatch is launched in a frame.
 * @param {Dispatch} dispatch
 * @param {number} number of the frame, from 0
 * @param {State} before the state as last read; without it all its members are 0
 * @returns {boolean}
 */
export function takesPlace(dispatch, number, before = {}) {
  return dispatch.frames.some(
    ({ first, last, every, after }) =>
      (after === null || Boolean(before[after])) &&
      number >= first && (last === null || number <= last) && number % every === 0,
  );
}

/**
 * The state of a frame that is left out: the one that is NUMBER (from 0) after the one whose state was read; null
 * where it is computed.
 * @param {Plan} plan
 * @param {State} state as last read
 * @param {number} number
 * @returns {State | null}
 */
export function servedState({ skipping }, state, number) {
  if (!skipping || number >= Number(state[skipping.count] ?? 0)) return null;
  const poses = /** @type {Float32Array} */ (state[skipping.poses]);
  const { length } = /** @type {Float32Array} */ (state[skipping.pose]);
  return { ...state, [skipping.pose]: poses.slice(number * length, (number + 1) * length) };
}

/**
 * How many groups cover a dispatch, in each direction.
 * @param {Dispatch} dispatch
 * @returns {number[]}
 */
export function groupsOf(dispatch) {
  return dispatch.size.map((size, direction) => Math.ceil(size / dispatch.group[direction]));
}

/**
 * The dispatches in their order, those together that share their stage and their frames.
 * @param {Plan} plan
 * @returns {Segment[]}
 */
export function segmentsOf(plan) {
  /** @type {Segment[]} */
  const segments = [];
  let key = "";
  for (const dispatch of plan.dispatches) {
    const frames = dispatch.frames.map(({ first, last, every, after }) => [first, last, every, after]);
    const own = JSON.stringify([dispatch.stage, frames]);
    if (segments.length && own === key) segments[segments.length - 1].dispatches.push(dispatch);
    else segments.push({ stage: dispatch.stage, dispatches: [dispatch] });
    key = own;
  }
  return segments;
}

/**
 * The stages of a frame in their order.
 * @param {Plan} plan
 * @returns {string[]}
 */
export function stagesOf(plan) {
  return [...new Set(plan.dispatches.map((dispatch) => dispatch.stage))];
}

/**
 * The stages of a frame before anything was launched: 0 seconds each.
 * @param {Plan} plan
 * @returns {Record<string, number>}
 */
export function idleStages(plan) {
  return Object.fromEntries(stagesOf(plan).map((stage) => [stage, 0]));
}

/**
 * Whether the camera is tracked in a frame.
 * @param {Plan} plan
 * @param {number} number
 * @returns {boolean}
 */
export function tracks(plan, number) {
  return plan.dispatches.some((dispatch) => dispatch.kernel === "check_pose" && takesPlace(dispatch, number));
}

/**
 * The number, in the plan, of the frame that follows the frame NUMBER: frame 0 is run again until an image measures
 * anything (slam/kfusion/plan.py).
 * @param {number} number
 * @param {State} state after the frame
 * @returns {number}
 */
export function nextNumber(number, state) {
  return number === 0 && state.farthest === 0 ? 0 : number + 1;
}

/**
 * Bytes of the state: its members lie one after another without padding.
 * @param {Plan} plan
 * @returns {number}
 */
export function stateBytes(plan) {
  return plan.state.reduce((sum, member) => sum + BYTES[member.type] * member.count, 0);
}

/**
 * The state before the first frame.
 * @param {Plan} plan
 * @returns {ArrayBuffer}
 */
export function initialState(plan) {
  const data = new ArrayBuffer(stateBytes(plan));
  const view = new DataView(data);
  let place = 0;
  for (const member of plan.state) {
    const values = plan.initial[member.name] ?? [];
    values.forEach((value, index) => setNumber(view, place + 4 * index, member.type, value));
    place += BYTES[member.type] * member.count;
  }
  return data;
}

/**
 * The values that lie in DATA, from its first byte on.
 * @param {Plan} plan
 * @param {ArrayBuffer} data
 * @returns {State}
 */
export function readState(plan, data) {
  /** @type {State} */
  const state = {};
  let place = 0;
  for (const member of plan.state) {
    const values = valuesOf(member.type, data, place, member.count);
    state[member.name] = member.count > 1 ? values : values[0];
    place += BYTES[member.type] * member.count;
  }
  return state;
}

/**
 * COUNT values of TYPE in DATA, from PLACE on.
 * @param {string} type
 * @param {ArrayBuffer} data
 * @param {number} place
 * @param {number} count
 * @returns {Float32Array | Int32Array | Uint32Array}
 */
function valuesOf(type, data, place, count) {
  if (type === "f32") return new Float32Array(data, place, count);
  return type === "i32" ? new Int32Array(data, place, count) : new Uint32Array(data, place, count);
}

/**
 * The buffer of a name.
 * @param {Plan} plan
 * @param {string} name
 * @returns {Buffer}
 */
export function bufferOf(plan, name) {
  const found = plan.buffers.find((buffer) => buffer.name === name);
  if (!found) throw new Error(`the plan has no buffer ${name}`);
  return found;
}

/**
 * The kernel of a name.
 * @param {Plan} plan
 * @param {string} name
 * @returns {Kernel}
 */
export function kernelOf(plan, name) {
  const found = plan.kernels.find((kernel) => kernel.name === name);
  if (!found) throw new Error(`the plan has no kernel ${name}`);
  return found;
}

/**
 * The buffer that holds the state.
 * @param {Plan} plan
 * @returns {Buffer}
 */
export function stateBuffer(plan) {
  const found = plan.buffers.find((buffer) => buffer.type === STATE);
  if (!found) throw new Error("the plan has no state");
  return found;
}

/**
 * Bytes of all planes of a buffer, each in whole 32-bit words.
 * @param {Plan} plan
 * @param {Buffer} buffer
 * @returns {number}
 */
export function bufferBytes(plan, buffer) {
  const size = buffer.type === STATE ? stateBytes(plan) : BYTES[buffer.type];
  return buffer.planes * Math.ceil((size * buffer.count) / 4) * 4;
}

/**
 * A kernel's parameters besides buffers, as laid out in its uniform buffer: vectors first, so that no padding is
 * needed.
 * @param {Kernel} kernel
 * @returns {Parameter[]}
 */
export function uniformsOf(kernel) {
  const scalars = kernel.parameters.filter((parameter) => parameter.access === null);
  const isVector = (/** @type {Parameter} */ parameter) => parameter.type === "vec4f";
  return [...scalars.filter(isVector), ...scalars.filter((parameter) => !isVector(parameter))];
}

/**
 * The uniform buffer of one dispatch, in whole blocks of 16 bytes; empty where its kernel has none.
 * @param {Kernel} kernel
 * @param {Dispatch} dispatch
 * @returns {Uint8Array<ArrayBuffer>}
 */
export function packedUniforms(kernel, dispatch) {
  const uniforms = uniformsOf(kernel);
  const size = uniforms.reduce((sum, uniform) => sum + BYTES[uniform.type], 0);
  const data = new Uint8Array(Math.ceil(size / 16) * 16);
  const view = new DataView(data.buffer);
  let place = 0;
  for (const parameter of uniforms) {
    for (const word of argumentWords(parameter, dispatch.arguments[parameter.name])) {
      view.setUint32(place, word, true);
      place += 4;
    }
  }
  return data;
}

/**
 * A number as a 32-bit word, and a vector as four.
 * @param {Parameter} parameter
 * @param {string | number | number[]} value
 * @returns {number[]}
 */
export function argumentWords({ type }, value) {
  const view = new DataView(new ArrayBuffer(4));
  return (Array.isArray(value) ? value : [value]).map((number) => {
    setNumber(view, 0, type === "vec4f" ? "f32" : type, Number(number));
    return view.getUint32(0, true);
  });
}

/**
 * @param {DataView} view
 * @param {number} place
 * @param {string} type
 * @param {number} value
 */
function setNumber(view, place, type, value) {
  if (type === "f32") view.setFloat32(place, value, true);
  else if (type === "i32") view.setInt32(place, value, true);
  else view.setUint32(place, value, true);
}
