/**
 * Sends waiting sessions once: the same bytes under the same key until the server answers (docs/data/protocol.md).
 */

import * as database from "./database.js";
import { gettext } from "./language.js";
import { Refusal, UnreachableError, ask, askJson } from "./server.js";
import * as sessions from "./sessions.js";
import { APP, VERSION } from "./version.js";

const FIRST_PAUSE_SECONDS = 30;
const LONGEST_PAUSE_SECONDS = 6 * 3600;
const SUMMARY_TRIES = 30;
const SUMMARY_PAUSE_MS = 500;
// Errors after which the same bytes will never be accepted.
const FINAL = new Set([400, 409, 413, 415, 422]);
// Errors about one submission that may be accepted later: the other sessions do not wait for it.
const ONE_SUBMISSION = new Set([408, 500]);

/** @typedef {import("./sessions.js").Session} Session */
/** @typedef {{id: string, token: string}} Installation */

/** Nothing more is sent until the visitor agrees again or reloads the page. */
export class StoppedError extends Error {
  /**
   * @param {"consent_outdated" | "outdated"} code
   * @param {string} message
   */
  constructor(code, message) {
    super(message);
    this.code = code;
  }
}

/**
 * Send pending erasures, then waiting sessions, oldest first. One tab does it at a time.
 * @returns {Promise<number>} milliseconds until the server may be asked again; 0 where nothing waits for that.
 *   Raises StoppedError.
 */
export function sendAll() {
  return navigator.locks.request("frontrunner-delivery", async () => {
    const pause = await remainingPause();
    if (pause > 0) return pause;
    if (!(await carryOutErasure())) return remainingPause();
    const waiting = (await sessions.all()).filter(isQueued).reverse();
    for (const session of waiting) {
      if (remainingTime(session.pause) > 0) continue;
      if (!(await send(session))) return remainingPause();
      await database.remove("settings", "pause");
    }
    const times = waiting.filter(isQueued).map(({ pause }) => remainingTime(pause));
    return times.length ? Math.min(...times) : 0;
  });
}

/** @param {Session} session */
function isQueued({ state }) {
  return state === "queued";
}

/** @returns {Promise<number>} milliseconds until the server may be asked again */
async function remainingPause() {
  return remainingTime(await database.read("settings", "pause"));
}

/**
 * @param {{since: number, until: number} | undefined} pause
 * @returns {number} milliseconds until it is over; 0 where the clock was set back since it began
 */
function remainingTime(pause) {
  const now = Date.now();
  return pause && now >= (pause.since ?? 0) ? Math.max(pause.until - now, 0) : 0;
}

/**
 * Send SESSION and store the outcome.
 * @param {Session} session
 * @param {boolean} [enrolledAgain] whether another installation was just refused
 * @returns {Promise<boolean>} whether the next one may be sent now
 */
async function send(session, enrolledAgain = false) {
  let submitted = false; // a refusal to enrol says nothing about the session
  try {
    const installation = await enrolled(session.manifest.consent_version);
    submitted = true;
    const answer = await askJson("/submissions", {
      method: "POST",
      token: installation.token,
      body: session.body ?? "",
      headers: { "Idempotency-Key": session.key },
    });
    const states = new Set(answer.items.map((/** @type {{status: string}} */ item) => item.status));
    session.state = states.has("accepted") ? "accepted" : states.has("duplicate") ? "duplicate" : "rejected";
    session.reason = answer.items.find((/** @type {any} */ item) => item.code)?.detail ?? "";
    session.answer = { submission_id: answer.submission_id };
    await sessions.keep(session);
    return true;
  } catch (error) {
    if (error instanceof Refusal) return refused(session, error, submitted, enrolledAgain);
    if (error instanceof UnreachableError) return later(session, error.noNetwork ? "" : error.message, null);
    throw error;
  }
}

/**
 * @param {Session} session
 * @param {Refusal} error
 * @param {boolean} submitted whether the submission was refused, not the enrolment before it
 * @param {boolean} enrolledAgain
 * @returns {Promise<boolean>}
 */
async function refused(session, error, submitted, enrolledAgain) {
  if (error.status === 401 || error.code === "device_changed") {
    if (enrolledAgain) return later(session, error.message, null);
    // The installation is gone on the server, or belongs to another device: a new one sends the same bytes.
    await retire();
    return send(session, true);
  }
  if (error.status === 426) throw new StoppedError("outdated", gettext("This page is out of date: load it again."));
  if (error.code === "consent_outdated") {
    await database.remove("settings", "consent");
    throw new StoppedError("consent_outdated", gettext("What is sent has changed: please read it and agree again."));
  }
  if (!submitted || error.retryAfter !== null) return later(session, error.message, error.retryAfter);
  if (FINAL.has(error.status)) {
    session.state = "rejected";
    session.reason = error.message;
    await sessions.keep(session);
    return true;
  }
  if (!ONE_SUBMISSION.has(error.status)) return later(session, error.message, null);
  session.pause = nextPause(session.pause?.tries ?? 0, null);
  session.reason = error.message;
  await sessions.keep(session);
  return true;
}

/**
 * Pause all requests for SECONDS, or for a random time that grows with each try. SESSION waits.
 * @param {Session} session
 * @param {string} reason
 * @param {number | null} seconds
 * @returns {Promise<boolean>} false: the other sessions wait, too
 */
async function later(session, reason, seconds) {
  await pauseFor(seconds);
  session.reason = reason;
  await sessions.keep(session);
  return false;
}

/** @param {number | null} seconds */
async function pauseFor(seconds) {
  const tries = (await database.read("settings", "pause"))?.tries ?? 0;
  await database.write("settings", "pause", { ...nextPause(tries, seconds), asked: seconds !== null });
}

/**
 * A pause of SECONDS, or of a random time that grows with the TRIES before it.
 * @param {number} tries
 * @param {number | null} seconds
 * @returns {{since: number, until: number, tries: number}}
 */
function nextPause(tries, seconds) {
  const longest = Math.min(FIRST_PAUSE_SECONDS * 2 ** tries, LONGEST_PAUSE_SECONDS);
  const since = Date.now();
  return { since, until: since + 1000 * (seconds ?? Math.random() * longest), tries: tries + 1 };
}

/** The network is back: sessions that waited only for it are due. */
export async function endPause() {
  const pause = await database.read("settings", "pause");
  if (pause && !pause.asked) await database.remove("settings", "pause");
}

/**
 * This browser's installation on the server, enrolled on first use.
 * @param {number} consentVersion
 * @returns {Promise<Installation>}
 */
async function enrolled(consentVersion) {
  const known = await database.read("settings", "installation");
  if (known) return known;
  /** @type {import("./wire.d.ts").Enrolment} */
  const enrolment = { app: APP, app_version: VERSION, consent_version: consentVersion };
  const body = JSON.stringify(enrolment);
  const answer = await askJson("/enrol", { method: "POST", body });
  const installation = { id: answer.installation_id, token: answer.token };
  await database.write("settings", "installation", installation);
  return installation;
}

/**
 * The tokens that read and erase what this browser sent; none before the first session is sent.
 * @returns {Promise<string[]>}
 */
export async function tokens() {
  const installation = await database.read("settings", "installation");
  const former = (await database.read("settings", "former")) ?? [];
  return [...(installation ? [installation] : []), ...former].map(({ token }) => token);
}

/** Keep the installation's token for an erasure. The next session enrols again. */
async function retire() {
  const installation = await database.read("settings", "installation");
  const former = (await database.read("settings", "former")) ?? [];
  if (installation) await database.write("settings", "former", [...former, installation]);
  await database.remove("settings", "installation");
}

/**
 * The server's evaluation of an accepted SESSION; null until it was processed.
 * @param {Session} session
 * @returns {Promise<any>}
 */
export async function summaryOf(session) {
  const installation = await database.read("settings", "installation");
  if (!installation || !session.answer) return null;
  for (let tries = 0; tries < SUMMARY_TRIES; tries++) {
    const state = await askJson(`/submissions/${session.answer.submission_id}`, { token: installation.token });
    if (state.summarised) return state;
    await new Promise((resolve) => setTimeout(resolve, SUMMARY_PAUSE_MS));
  }
  return null;
}

/**
 * All data of this browser, here and on the server.
 * @returns {Promise<object>}
 */
export async function exported() {
  const installation = await database.read("settings", "installation");
  const server = installation ? await askJson("/me/data", { token: installation.token }) : null;
  return { sessions: await sessions.all(), server };
}

/** Erase everything here, and on the server as soon as it can be reached. */
export async function erase() {
  const installation = await database.read("settings", "installation");
  const former = (await database.read("settings", "former")) ?? [];
  const wishes = (await database.read("settings", "erasing")) ?? [];
  await database.write("settings", "erasing", [...wishes, ...former, ...(installation ? [installation] : [])]);
  await Promise.all(["installation", "former", "consent", "stated"].map((name) => database.remove("settings", name)));
  await database.clear("sessions");
  await sendAll();
}

/**
 * Whether the server still has something to erase.
 * @returns {Promise<boolean>}
 */
export async function isErasing() {
  return Boolean((await database.read("settings", "erasing"))?.length);
}

/**
 * Deliver pending erasures to the server.
 * @returns {Promise<boolean>} whether nothing is left to erase
 */
export async function carryOutErasure() {
  /** @type {Installation[]} */
  let left = (await database.read("settings", "erasing")) ?? [];
  for (const installation of left) {
    try {
      await ask("/me", { method: "DELETE", token: installation.token });
    } catch (error) {
      const gone = error instanceof Refusal && (error.status === 401 || error.status === 404);
      if (!gone && !(error instanceof Refusal || error instanceof UnreachableError)) throw error;
      if (!gone) {
        await pauseFor(error instanceof Refusal ? error.retryAfter : null);
        return false;
      }
    }
    left = left.filter(({ id }) => id !== installation.id);
    await database.write("settings", "erasing", left);
  }
  return true;
}

/**
 * Whether the server may show this device's model even if few people measured it; null where it cannot be asked.
 * @returns {Promise<boolean | null>}
 */
export async function isModelShown() {
  const installation = await database.read("settings", "installation");
  if (!installation) return null;
  try {
    return (await askJson("/me", { token: installation.token })).show_model;
  } catch (error) {
    if (error instanceof Refusal || error instanceof UnreachableError) return null;
    throw error;
  }
}

/**
 * Whether the model of this device may be shown in public even if few people measured it.
 * @param {boolean} shown
 */
export async function showModel(shown) {
  const installation = await database.read("settings", "installation");
  if (!installation) return;
  const body = JSON.stringify({ show_model: shown });
  await ask("/me", { method: "PATCH", token: installation.token, body });
}
