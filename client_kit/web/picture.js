/** The picture of the model as the camera sees it (slam/reports/render.py). */

const BACKGROUND = [22, 24, 30]; // red green blue, where no surface is seen
const SURFACE = [235, 232, 225];
const AMBIENT = 0.15;

/**
 * The buffers of a plan that show the model, filled by the last raycast of a frame, and their size.
 * @typedef {{vertices: string, normals: string, width: number, height: number}} View
 */

/**
 * The view of the model in PLAN; null without a raycast.
 * @param {import("./plan.js").Plan} plan
 * @returns {View | null}
 */
export function viewOf(plan) {
  const raycast = plan.dispatches.find((dispatch) => dispatch.kernel === "raycast");
  if (!raycast) return null;
  const { vertices, normals, width, height } = raycast.arguments;
  return {
    vertices: String(vertices),
    normals: String(normals),
    width: Number(width),
    height: Number(height),
  };
}

/**
 * RGBA of surfaces lit from the camera (Lambert).
 * @param {Float32Array} vertices metres: all x, then all y, then all z
 * @param {Float32Array} normals of unit length, in the same order; 0 where no surface is seen
 * @param {ArrayLike<number>} eye the camera's centre
 * @returns {Uint8ClampedArray<ArrayBuffer>}
 */
export function shade(vertices, normals, eye) {
  const count = vertices.length / 3;
  const pixels = new Uint8ClampedArray(4 * count);
  for (let pixel = 0; pixel < count; pixel++) {
    let squared = 0;
    let along = 0;
    let seen = false;
    for (let axis = 0; axis < 3; axis++) {
      const normal = normals[axis * count + pixel];
      const towards = eye[axis] - vertices[axis * count + pixel];
      squared += towards * towards;
      along += towards * normal;
      seen ||= normal !== 0;
    }
    seen &&= squared > 0;
    const cosine = seen ? Math.min(Math.max(along / Math.sqrt(squared), 0), 1) : 0;
    const brightness = AMBIENT + (1 - AMBIENT) * cosine;
    for (let channel = 0; channel < 3; channel++) {
      pixels[4 * pixel + channel] = seen ? Math.floor(brightness * SURFACE[channel]) : BACKGROUND[channel];
    }
    pixels[4 * pixel + 3] = 255;
  }
  return pixels;
}
