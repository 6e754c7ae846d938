/** The consent of a device's owner, with the values of this device. */

import * as database from "./database.js";
import { payload } from "./sessions.js";

/** @typedef {import("./server.js").Manifest} Manifest */
/** @typedef {import("./device.js").Identity} Identity */

/**
 * Whether the owner agreed to this consent version.
 * @param {Manifest} manifest
 * @returns {Promise<boolean>}
 */
export async function isGiven(manifest) {
  return (await database.read("settings", "consent")) === manifest.consent_version;
}

/**
 * Record that the owner agrees.
 * @param {Manifest} manifest
 */
export function give(manifest) {
  return database.write("settings", "consent", manifest.consent_version);
}

/**
 * An example payload of this device, with one run of two frames for brevity.
 * @param {Manifest} manifest
 * @param {Identity} device
 * @param {import("./measurement.js").Backend} backend
 * @returns {string} JSON, lists of numbers on one line
 */
export function sample(manifest, device, backend) {
  const { application, front_version, protocol, consent_version } = manifest;
  /** @type {import("./run-record.js").Run} */
  const run = {
    id: "a random number", configuration: "default", repeat: 0, order: 0, status: "ok", failure: null,
    frame_us: [31250, 30718], tracked: [true, true], ate_max: 0.012, ate_mean: 0.008, ate_rmse: 0.009,
    deviation: 0.0004,
  };
  const session = {
    id: "a random number", startedAt: "2026-01-01T12:00:00Z", device, runs: [run],
    manifest: { application, front_version, protocol, consent_version },
  };
  const threads = backend === "wasm" && { threads: 4, threads_claimed: navigator.hardwareConcurrency };
  const sent = payload(/** @type {any} */ (session), { backend, ...threads, stage_clock: "none", empty_frame_us: 212.5 });
  return JSON.stringify(sent, null, 2).replace(/\[\s+([^[\]{}]*?)\s+\]/g, (_, inner) => `[${inner.replace(/\s+/g, " ")}]`);
}
