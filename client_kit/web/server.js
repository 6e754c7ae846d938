/** Requests to the server that this page came from. */

import * as database from "./database.js";
import { gettext } from "./language.js";

const API = "/api/v1";
const MANIFEST_MS = 15_000; // until the manifest must have arrived: a captive network answers nothing

/** An error answer of the server. `retryAfter` in seconds, or null. */
export class Refusal extends Error {
  /**
   * @param {number} status
   * @param {{code?: string, detail?: string}} problem
   * @param {number | null} retryAfter
   */
  constructor(status, problem, retryAfter) {
    super(problem.detail ?? gettext("the server answered %(status)s", { status }));
    this.status = status;
    this.code = problem.code ?? "";
    this.retryAfter = retryAfter;
  }

  /** Whether the same request may succeed later. */
  get temporary() {
    return this.status === 429 || this.status >= 500;
  }
}

const NOT_UNDERSTOOD = gettext(
  "Something else answered, or the answer broke off. Does this network ask you to log in? Open any other page to find out, then come back.",
);

/** The server cannot be reached; the message says what to do. */
export class UnreachableError extends Error {
  /** Whether nothing answered at all. */
  get noNetwork() {
    return this.cause instanceof TypeError;
  }
}

/** A download does not match its digest. */
export class DamagedError extends Error {}

/**
 * Request PATH of the API. JSON in and out.
 * @param {string} path
 * @param {{method?: string, token?: string, body?: string, headers?: Record<string, string>, signal?: AbortSignal}} [request]
 * @returns {Promise<Response>} with status 200 to 399
 */
export async function ask(path, { method = "GET", token, body, headers = {}, signal } = {}) {
  const sent = { ...headers };
  if (token) sent.Authorization = `Bearer ${token}`;
  if (body !== undefined) sent["Content-Type"] = "application/json";
  let response;
  try {
    response = await fetch(`${API}${path}`, { method, headers: sent, body, signal, redirect: "error", cache: "no-store" });
  } catch (error) {
    const slow = error instanceof DOMException && error.name === "TimeoutError";
    const remedy = slow ? gettext("It did not answer in time: load this page again.") : gettext("Try again when there is a network.");
    throw new UnreachableError(remedy, { cause: error });
  }
  if (response.ok || response.status === 304) return response;
  throw new Refusal(response.status, await problemOf(response), secondsOf(response.headers.get("Retry-After")));
}

/**
 * Request PATH and read its JSON. An incomplete answer counts as none.
 * @param {string} path
 * @param {Parameters<typeof ask>[1]} [request]
 * @returns {Promise<any>}
 */
export async function askJson(path, request) {
  const response = await ask(path, request);
  try {
    return await response.json();
  } catch (error) {
    throw new UnreachableError(NOT_UNDERSTOOD, { cause: error });
  }
}

/**
 * @param {Response} response
 * @returns {Promise<{code?: string, detail?: string}>}
 */
async function problemOf(response) {
  try {
    const problem = await response.json();
    return problem && typeof problem === "object" ? problem : {};
  } catch {
    return {};
  }
}

/**
 * @param {string | null} header
 * @returns {number | null}
 */
function secondsOf(header) {
  const seconds = Number(header);
  return header !== null && Number.isFinite(seconds) && seconds >= 0 ? seconds : null;
}

/** @typedef {import("./wire.d.ts").Manifest} Manifest */
/** @typedef {import("./wire.d.ts").ContentReference} ContentReference */

/**
 * The manifest; without a network, the one of the last visit.
 * @returns {Promise<Manifest>}
 */
export async function readManifest() {
  const kept = await database.read("settings", "manifest");
  try {
    /** @type {Record<string, string>} */
    const headers = kept ? { "If-None-Match": kept.etag } : {};
    const response = await ask("/manifest", { headers, signal: AbortSignal.timeout(MANIFEST_MS) });
    if (response.status === 304) return kept.manifest;
    const manifest = await response.json().catch((error) => {
      throw new UnreachableError(NOT_UNDERSTOOD, { cause: error });
    });
    await database.write("settings", "manifest", { etag: response.headers.get("ETag") ?? "", manifest });
    return manifest;
  } catch (error) {
    const away = error instanceof UnreachableError;
    if (kept && (away || (error instanceof Refusal && error.temporary))) return kept.manifest;
    throw error;
  }
}

/**
 * A file by its digest: stored, or else downloaded, checked and stored.
 * @param {ContentReference} file
 * @returns {Promise<ArrayBuffer>}
 */
export async function download({ sha256, url }) {
  const kept = await database.read("files", sha256);
  if (kept) return kept;
  let response;
  try {
    response = await fetch(url, { redirect: "error" });
    if (!response.ok) throw new Refusal(response.status, {}, secondsOf(response.headers.get("Retry-After")));
    const content = await response.arrayBuffer();
    if ((await digest(content)) !== sha256) throw new DamagedError(gettext("%(url)s is damaged: its SHA-256 differs", { url }));
    await database.write("files", sha256, content);
    return content;
  } catch (error) {
    if (error instanceof TypeError) throw new UnreachableError(gettext("Try again when there is a network."), { cause: error });
    throw error;
  }
}

/**
 * The same, as JSON.
 * @param {ContentReference} file
 * @returns {Promise<any>}
 */
export async function downloadJson(file) {
  return JSON.parse(new TextDecoder().decode(await download(file)));
}

/**
 * @param {ArrayBuffer} content
 * @returns {Promise<string>} SHA-256, hexadecimal
 */
async function digest(content) {
  const bytes = new Uint8Array(await crypto.subtle.digest("SHA-256", content));
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
}

/**
 * Count the steps of visitors anonymously. The answer is not awaited.
 * @param {string} step
 * @param {{reason?: string, gpu?: {vendor: string, architecture: string}, browser?: string | null}} [more]
 */
export function countAttempt(step, { reason, gpu, browser } = {}) {
  const body = JSON.stringify({
    step, reason, browser: browser ?? undefined, gpu_vendor: gpu?.vendor, gpu_architecture: gpu?.architecture,
  });
  ask("/attempts", { method: "POST", body }).catch(() => {});
}
