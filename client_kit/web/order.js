/** What the worker is given to measure: a backend, and files of the server. */

import * as database from "./database.js";
import { canExecute } from "./processor.js";
import { download, downloadJson } from "./server.js";

/** @typedef {import("./server.js").Manifest} Manifest */
/** @typedef {import("./gpu-device.js").AdapterInfo} AdapterInfo */

/**
 * What MANIFEST is measured by: WebGPU where there is an adapter and all configurations run on it, else WebAssembly;
 * null where neither runs them all.
 * @param {Manifest} manifest
 * @param {AdapterInfo | null | undefined} adapter
 * @returns {"webgpu" | "wasm" | null}
 */
export function backendFor({ configurations, protocol }, adapter) {
  const measured = configurations.filter(({ name }) => protocol.order.includes(name));
  if (protocol.version !== 2 || !measured.every(({ trajectory }) => trajectory)) return null;
  if (adapter && measured.every(({ plan, shaders }) => plan && shaders)) return "webgpu";
  return canExecute() && measured.every(({ wasm }) => wasm) ? "wasm" : null;
}

/**
 * What the worker measures MANIFEST from: its files, downloaded where missing.
 * @param {Manifest} manifest
 * @param {"webgpu" | "wasm"} backend
 * @param {(done: number, total: number) => void} showDownload of bytes of the recording that this browser lacks
 */
export async function orderOf(manifest, backend, showDownload) {
  const { protocol, sequence } = manifest;
  const kept = await Promise.all(sequence.chunks.map(({ sha256 }) => database.read("files", sha256)));
  const total = sequence.chunks.reduce((sum, { bytes }, number) => sum + (kept[number] ? 0 : bytes), 0);
  const chunks = [];
  let done = 0;
  for (const [number, chunk] of sequence.chunks.entries()) {
    if (!kept[number]) showDownload(done, total);
    chunks.push(kept[number] ?? (await download(chunk)));
    if (!kept[number]) done += chunk.bytes;
  }
  const configurations = [];
  let module;
  for (const { name, band, plan, shaders, wasm, trajectory } of manifest.configurations) {
    if (!protocol.order.includes(name) || !trajectory) continue;
    const configuration = { name, band, trajectory: await downloadJson(trajectory) };
    if (backend === "wasm" && wasm) {
      module = await download(wasm.module);
      configurations.push({ ...configuration, plan: await downloadJson(wasm.plan) });
    } else if (plan && shaders) {
      configurations.push({ ...configuration, plan: await downloadJson(plan), shaders: await downloadJson(shaders) });
    }
  }
  const [header, ...frames] = chunks;
  return { type: "measure", backend, module, protocol, configurations, header, chunks: frames };
}
