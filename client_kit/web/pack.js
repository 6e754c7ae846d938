/**
 * The codec of sequence packs (docs/data/protocol.md, section 2; slam/datasets/formats/codec.py): a header, then
 * chunks of depth images. The caller has compared the chunks with their digests.
 */

const FORMAT = 1;
const MAXIMAL_HEADER = 64 * 2 ** 20; // bytes of inflated header, as slam/datasets/formats/pack.py

/**
 * The content of a pack's first chunk. `truth` holds for each frame the upper three rows of the true pose, camera to
 * world, row by row, or null where it is not known.
 * @typedef {object} Header
 * @property {string} name
 * @property {number} width
 * @property {number} height
 * @property {number} frames
 * @property {number} framesPerChunk
 * @property {{fx: number, fy: number, cx: number, cy: number, width: number, height: number}} camera
 * @property {number[]} timestamps
 * @property {(number[] | null)[]} truth
 */

/** A pack that is damaged, or of an unknown format. */
export class PackError extends Error {}

/**
 * Read the header, a pack's first chunk.
 * @param {ArrayBuffer} chunk
 * @returns {Promise<Header>}
 * @throws {PackError} where it is not the header of a depth pack
 */
export async function readHeader(chunk) {
  /** @type {any} */
  let header;
  try {
    const text = new TextDecoder("utf-8", { fatal: true }).decode(await inflated(chunk, MAXIMAL_HEADER));
    header = JSON.parse(text);
  } catch (error) {
    throw new PackError(`the sequence's header cannot be read: ${reason(error)}`);
  }
  if (header?.format !== FORMAT || header.kind !== "depth") {
    throw new PackError(`the sequence is not a depth pack of format ${FORMAT}`);
  }
  const counts = [header.width, header.height, header.frames, header.frames_per_chunk];
  if (!counts.every((count) => Number.isInteger(count) && count > 0)) {
    throw new PackError(`the sequence's header has sizes that are not positive whole numbers: ${counts}`);
  }
  const truth = header.truth ?? new Array(header.frames).fill(null);
  if (truth.length !== header.frames || header.timestamps?.length !== header.frames) {
    throw new PackError(`the sequence's header does not have one time and one true pose for each frame`);
  }
  return {
    name: String(header.name),
    width: header.width,
    height: header.height,
    frames: header.frames,
    framesPerChunk: header.frames_per_chunk,
    camera: header.camera,
    timestamps: header.timestamps,
    truth,
  };
}

/**
 * Decode the first frames of a pack.
 * @param {Header} header
 * @param {ArrayBuffer[]} chunks those after the header, in order
 * @param {number} count how many frames
 * @param {(done: number) => void} [onFrame] called after each frame
 * @returns {Promise<Uint16Array<ArrayBuffer>[]>} millimetres, row by row, 0 where nothing was measured
 * @throws {PackError} where a chunk is missing or damaged
 */
export async function readFrames(header, chunks, count, onFrame = () => {}) {
  if (count > header.frames) {
    throw new PackError(`the sequence has ${header.frames} frames, ${count} are needed`);
  }
  const frames = [];
  for (let frame = 0; frame < count; frame++) {
    const chunk = chunks[Math.floor(frame / header.framesPerChunk)];
    if (!chunk) throw new PackError(`the chunk of frame ${frame} is missing`);
    frames.push(await readFrame(chunk, frame % header.framesPerChunk, header.width, header.height));
    onFrame(frame + 1);
  }
  return frames;
}

/**
 * Decode one frame of a chunk.
 * @param {ArrayBuffer} chunk
 * @param {number} index of the frame in the chunk
 * @param {number} width
 * @param {number} height
 * @returns {Promise<Uint16Array<ArrayBuffer>>}
 * @throws {PackError} where the chunk is damaged
 */
export async function readFrame(chunk, index, width, height) {
  const pixels = width * height;
  try {
    const view = new DataView(chunk);
    const depths = view.getUint32(0, true);
    const palette = new Uint16Array(chunk.slice(4, 4 + 2 * depths));
    if (palette.length !== depths) throw new RangeError("its depths are cut short");
    const planes = await inflated(part(view, 4 + 2 * depths, index), 2 * pixels);
    if (planes.length !== 2 * pixels) throw new RangeError(`${planes.length} bytes, not ${2 * pixels}`);
    const frame = new Uint16Array(pixels);
    let rank = 0;
    let largest = 0;
    for (let pixel = 0; pixel < pixels; pixel++) {
      const folded = planes[pixel] | (planes[pixels + pixel] << 8);
      rank = (rank + ((folded >> 1) ^ -(folded & 1))) & 0xffff;
      if (rank > largest) largest = rank;
      frame[pixel] = palette[rank];
    }
    if (largest >= depths) throw new RangeError(`a rank of ${largest} among ${depths} depths`);
    return frame;
  } catch (error) {
    const bytes = chunk.byteLength;
    throw new PackError(`frame ${index} of a chunk of ${bytes} bytes is damaged: ${reason(error)}`);
  }
}

/**
 * The bytes of one frame; each is preceded by its size.
 * @param {DataView<ArrayBuffer>} view
 * @param {number} begin the position of the first frame's size
 * @param {number} index
 * @returns {ArrayBuffer}
 */
function part(view, begin, index) {
  for (let frame = 0; frame < index; frame++) begin += 4 + view.getUint32(begin, true);
  const size = view.getUint32(begin, true);
  const data = view.buffer.slice(begin + 4, begin + 4 + size);
  if (data.byteLength !== size) throw new RangeError(`${data.byteLength} of ${size} bytes`);
  return data;
}

/**
 * Inflate a zlib stream of at most so many bytes.
 * @param {ArrayBuffer} data
 * @param {number} limit
 * @returns {Promise<Uint8Array<ArrayBuffer>>}
 */
async function inflated(data, limit) {
  const reader = new Blob([data]).stream().pipeThrough(new DecompressionStream("deflate")).getReader();
  /** @type {Uint8Array[]} */
  const parts = [];
  let size = 0;
  for (let next = await reader.read(); !next.done; next = await reader.read()) {
    size += next.value.length;
    if (size > limit) {
      await reader.cancel();
      throw new RangeError(`more than ${limit} bytes`);
    }
    parts.push(next.value);
  }
  const whole = new Uint8Array(size);
  let place = 0;
  for (const bytes of parts) {
    whole.set(bytes, place);
    place += bytes.length;
  }
  return whole;
}

/**
 * @param {unknown} error
 * @returns {string}
 */
function reason(error) {
  return error instanceof Error ? error.message : String(error);
}
