/**
 * The sessions that this browser measured: one may be in progress, the others wait for the server or have its
 * answer. A finished run is on disk before the next one starts.
 */

import { SCHEMA_VERSION } from "./constants.js";
import * as database from "./database.js";
import { plannedRuns } from "./schedule.js";
import { VERSION } from "./version.js";

/** The lock of the tab that measures. */
export const LOCK = "frontrunner-measuring";
// After a longer rest the device is in another state than in the first runs.
export const RESUMABLE_MS = 30 * 60 * 1000;

/** @typedef {import("./server.js").Manifest} Manifest */
/** @typedef {import("./run-record.js").Run} Run */
/** @typedef {import("./measurement.js").SessionClock} SessionClock */
/** @typedef {import("./device.js").Identity} Identity */
/** @typedef {"measuring" | "queued" | "accepted" | "duplicate" | "rejected"} State */

/**
 * `manifest` is the part that a result page needs. `body` and `key` are sent, and do not change until there is an
 * answer. `changedAt` is the time of the last write (milliseconds since 1970). `answer` is the server's. `probes`
 * names the assigned configurations; sessions of earlier versions of this page lack it. `blocksRepeated` counts the blocks
 * of runs that were measured again. `disturbed`: other programs disturbed a block after its last try, too. `counts`: what the
 * server said of the speedup, where it did. `pause` is there after the server failed on this session alone, and ends at
 * `until` (milliseconds since 1970).
 * @typedef {object} Session
 * @property {string} id
 * @property {string} startedAt
 * @property {State} state
 * @property {Pick<Manifest, "application" | "front_version" | "protocol" | "consent_version">} manifest
 * @property {Record<string, number>} bands
 * @property {Identity} device
 * @property {string[]} [probes]
 * @property {SessionClock | null} clock
 * @property {Run[]} runs
 * @property {number} [blocksRepeated]
 * @property {boolean} [disturbed]
 * @property {string | null} body
 * @property {string} key
 * @property {number} changedAt
 * @property {string} reason
 * @property {any} answer
 * @property {boolean} [counts]
 * @property {{since: number, until: number, tries: number}} [pause]
 */

/**
 * A new, stored session for MANIFEST.
 * @param {Manifest} manifest
 * @param {Identity} device
 * @returns {Promise<Session>}
 */
export async function begin(manifest, device) {
  const { application, front_version, protocol, consent_version } = manifest;
  const bands = Object.fromEntries(manifest.configurations.map(({ name, band }) => [name, band ?? Infinity]));
  /** @type {Session} */
  const session = {
    id: crypto.randomUUID(),
    startedAt: new Date().toISOString().replace(/\.\d+Z$/, "Z"),
    state: "measuring",
    manifest: { application, front_version, protocol, consent_version },
    bands,
    device,
    probes: (manifest.assigned ?? []).map(({ name }) => name),
    clock: null,
    runs: [],
    body: null,
    key: crypto.randomUUID(),
    changedAt: 0,
    reason: "",
    answer: null,
  };
  await keep(session);
  return session;
}

/**
 * Store SESSION; it is on disk when the promise resolves.
 * @param {Session} session
 */
export function keep(session) {
  session.changedAt = Date.now();
  return database.write("sessions", session.id, session);
}

/**
 * All sessions, newest first.
 * @returns {Promise<Session[]>}
 */
export async function all() {
  const sessions = /** @type {Session[]} */ (await database.readAll("sessions"));
  return sessions.sort((a, b) => b.startedAt.localeCompare(a.startedAt));
}

/**
 * Whether a tab of this browser is measuring.
 * @returns {Promise<boolean>}
 */
export async function isMeasuring() {
  const { held = [] } = await navigator.locks.query();
  return held.some(({ name }) => name === LOCK);
}

/**
 * The session in progress that MANIFEST can continue on BACKEND, or null: the same front and the same runs. Others in
 * progress are ended, and their finished runs are queued. Call it only while no other tab measures.
 * @param {Manifest} manifest
 * @param {import("./measurement.js").Backend} backend
 * @returns {Promise<Session | null>}
 */
export async function resumable(manifest, backend) {
  let found = null;
  for (const session of (await all()).filter(({ state }) => state === "measuring")) {
    const young = Date.now() - session.changedAt < RESUMABLE_MS;
    const same = session.manifest.front_version === manifest.front_version && sameRuns(session.manifest, manifest);
    if (!found && young && same && session.clock?.backend === backend && session.runs.length) found = session;
    else await end(session);
  }
  return found;
}

/**
 * @param {Pick<Manifest, "protocol">} one
 * @param {Pick<Manifest, "protocol">} other
 * @returns {boolean} whether both ask for the same runs in the same order
 */
function sameRuns(one, other) {
  const [here, there] = [one, other].map(({ protocol }) => JSON.stringify(plannedRuns(protocol)));
  return here === there;
}

/**
 * End SESSION: queue it for sending, or delete it if no run was finished.
 * @param {Session} session
 */
export async function end(session) {
  if (!session.runs.length || !session.clock) return database.remove("sessions", session.id);
  session.state = "queued";
  session.body = JSON.stringify(payload(session, session.clock));
  return keep(session);
}

/**
 * The owner agreed to another consent version: waiting sessions are sent under it, with new keys.
 * @param {number} version
 */
export async function agreedTo(version) {
  for (const session of await all()) {
    if (session.state !== "queued" || session.manifest.consent_version === version) continue;
    session.manifest.consent_version = version;
    session.key = crypto.randomUUID();
    await end(session);
  }
}

/**
 * The body of POST /submissions (docs/data/protocol.md).
 * @param {Session} session
 * @param {SessionClock} clock
 * @returns {import("./wire.d.ts").Submission}
 */
export function payload({ id, startedAt, manifest, device, runs, blocksRepeated = 0 }, clock) {
  const { application, front_version, protocol, consent_version } = manifest;
  return {
    schema_version: SCHEMA_VERSION,
    app_version: VERSION,
    consent_version,
    device,
    sessions: [
      {
        id, started_at: startedAt, application, front_version, protocol_version: protocol.version,
        ...clock, blocks_repeated: blocksRepeated, samples: [], runs,
      },
    ],
  };
}
