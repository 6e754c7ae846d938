/**
 * The page /measure/: asks for consent, measures in a worker, stores every finished run, sends, and shows the result.
 */

import * as consent from "./consent.js";
import * as database from "./database.js";
import * as delivery from "./delivery.js";
import { browserOf, identify, isHandheld } from "./device.js";
import { element, showTitle } from "./elements.js";
import { saveFile } from "./files.js";
import { showKey } from "./kept-key.js";
import { gettext, megabytes, ngettext } from "./language.js";
import { NotMeasurableError, REASONS, hideNotice, say, serverAnswered } from "./notices.js";
import { backendFor, orderOf } from "./order.js";
import * as probes from "./probes.js";
import { draw, showBeginning, showDownload, showProgress } from "./progress.js";
import { showRecommendation, showResult, showSessions } from "./results.js";
import { Course } from "./course.js";
import { plannedRuns } from "./schedule.js";
import { DamagedError, Refusal, UnreachableError, askJson, countAttempt, readManifest } from "./server.js";
import * as sessions from "./sessions.js";
import { describeAdapter, requestAdapter } from "./gpu-device.js";
import { canExecute } from "./processor.js";
import { onStated } from "./stated-model.js";

const LONGEST_TIMER_MS = 2 ** 31 - 1; // that a browser's timer can count
// Silence of the worker after which it is given up: of frames, and of one step in which the driver compiles.
const FRAME_MS = 180_000;
const COMPILING_MS = 1_800_000;
const ADAPTER_MS = 10_000; // until WebGPU has answered, or does not count
// The worker's modules: cached, like all that this page loads, for a visit without a network.
const WORKER_FILES = [
  "worker.js", "measurement.js", "pack.js", "picture.js", "plan.js", "run-record.js", "stage-clock.js", "thread.js",
  "trajectory.js", "wasm.js", "webgpu.js",
];

/** @typedef {import("./server.js").Manifest} Manifest */
/** @typedef {import("./measurement.js").Message} Message */
/** @typedef {import("./sessions.js").Session} Session */
/** @typedef {import("./gpu-device.js").AdapterInfo} AdapterInfo */

const start = element("start", HTMLButtonElement);
const stop = element("stop", HTMLButtonElement);
const checking = element("checking", HTMLElement);
const running = element("running", HTMLElement);
const asking = element("asking", HTMLElement);

/** What this browser measures; without a graphics adapter by WebAssembly. @type {{manifest: Manifest, adapter: AdapterInfo | null} | null} */
let ready = null;
/** @type {Worker | null} */
let worker = null;
/** Whether the person pressed Stop. A hidden page stops too, and continues when it is visible. */
let stopped = false;
/** When this page was hidden while it measured (milliseconds since 1970); 0 where nothing waits for that. */
let pausedAt = 0;

async function prepare() {
  if (!window.isSecureContext) throw new NotMeasurableError("insecure");
  const adapter = navigator.gpu && (await within(ADAPTER_MS, requestAdapter(navigator.gpu)).catch(() => null));
  if (!navigator.locks || (!adapter && !canExecute())) throw new NotMeasurableError("no_wasm_simd");
  ready = { manifest: await readManifest(), adapter: adapter ? describeAdapter(adapter) : null };
  await showConsent();
}

/**
 * The result of WORK, null where it takes longer than MILLISECONDS.
 * @template T
 * @param {number} milliseconds
 * @param {Promise<T>} work
 * @returns {Promise<T | null>}
 */
function within(milliseconds, work) {
  return Promise.race([work, new Promise((resolve) => setTimeout(resolve, milliseconds, null))]);
}

async function showConsent() {
  if (!ready) return;
  const { manifest, adapter } = ready;
  const backend = backendFor(manifest, adapter);
  if (!backend) {
    return say(gettext("Nothing to measure in a browser"), gettext("The published front is for the native client."));
  }
  if (!manifest.accepting) {
    return say(gettext("The server does not accept measurements now"), manifest.message ?? gettext("Please come back later."));
  }
  const stated = await database.read("settings", "stated");
  const device = await identify(adapter, stated ?? null);
  const bytes = manifest.sequence.chunks.reduce((sum, chunk) => sum + chunk.bytes, 0);
  const size = megabytes(bytes);
  element("download", HTMLElement).textContent = gettext("%(size)s MB", { size });
  element("cost", HTMLElement).textContent = gettext("%(size)s MB are downloaded, once.", { size });
  element("sample", HTMLElement).textContent = consent.sample(manifest, device, backend);
  element("stated", HTMLElement).hidden = !isHandheld(device) || (Boolean(device.model) && !stated);
  const open = (await sessions.isMeasuring()) ? null : await sessions.resumable(manifest, backend);
  const runs = plannedRuns(manifest.protocol).length;
  const agreed = await consent.isGiven(manifest);
  const fresh = !agreed ? gettext("Agree and start") : element("result", HTMLElement).hidden ? gettext("Start") : gettext("Measure again");
  start.textContent = open ? gettext("Continue: %(done)s of %(runs)s runs are done", { done: open.runs.length, runs }) : fresh;
  asking.toggleAttribute("data-agreed", agreed);
  start.disabled = false;
  asking.hidden = false;
}

/**
 * Say why the measurement cannot go on, and count it.
 * @param {keyof typeof REASONS} code
 * @param {string} [detail]
 * @param {string} [kept] what happens to the runs
 */
function fail(code, detail = "", kept = "") {
  const [title, text] = REASONS[code];
  const unsupported = code === "insecure" || code === "no_wasm_simd";
  say(title, [kept, text].filter(Boolean).join(" "), { detail, final: unsupported || code === "wrong_results" });
  element("notice-browsers", HTMLElement).hidden = code !== "no_wasm_simd";
  count(unsupported ? "unsupported" : "failed", code);
}

/**
 * @param {string} what
 * @param {string} [reason]
 */
function count(what, reason) {
  countAttempt(what, { reason, gpu: ready?.adapter ?? undefined, browser: browserOf().name });
}

start.addEventListener("click", () => {
  start.disabled = true; // before anything is awaited: a second press starts nothing
  if (ready) agreeAndMeasure(ready.manifest).catch(showError);
});

/** @param {Manifest} manifest */
async function agreeAndMeasure(manifest) {
  if (!(await consent.isGiven(manifest))) {
    await consent.give(manifest);
    await sessions.agreedTo(manifest.consent_version);
    sendWaiting().catch(showError);
  }
  await measureAlone(manifest);
}

/**
 * Measure MANIFEST, unless another tab measures, and offer probes after an accepted session.
 * @param {Manifest} manifest
 */
async function measureAlone(manifest) {
  /** @type {Session | null} */
  let accepted = null;
  pausedAt = 0;
  try {
    accepted = await navigator.locks.request(sessions.LOCK, { ifAvailable: true }, async (lock) => {
      if (lock) return measure(manifest);
      say(gettext("Another tab is already measuring"), gettext("Two measurements would disturb each other."));
      return null;
    });
  } catch (error) {
    showError(error);
  }
  await showConsent();
  if (accepted) await offerProbes(accepted);
  await continueMeasuring();
}

/** Continue what this page left unfinished while it was hidden, unless that was long ago. */
async function continueMeasuring() {
  const long = Date.now() - pausedAt > sessions.RESUMABLE_MS;
  if (!ready || long || document.visibilityState === "hidden" || start.disabled) return;
  start.disabled = true;
  await measureAlone(ready.manifest);
}

/**
 * Show what the server assigns to this device after SESSION.
 * @param {Session} session
 */
async function offerProbes({ manifest: { application } }) {
  if (document.visibilityState === "hidden") return;
  const manifest = await probes.assignedManifest(application);
  if (!manifest?.accepting || !backendFor(manifest, ready?.adapter) || !(await consent.isGiven(manifest))) return;
  if (running.hidden) probes.offer(manifest, () => void measureAlone(manifest).catch(showError));
}

stop.addEventListener("click", () => {
  stopped = true;
  worker?.postMessage({ type: "stop" });
});
document.addEventListener("visibilitychange", () => {
  // A hidden page loses the device eventually, and computes at another speed.
  if (document.visibilityState === "hidden") worker?.postMessage({ type: "stop" });
  else continueMeasuring().catch(showError);
});

/**
 * Measure MANIFEST. While probes are measured, the result before them stays.
 * @param {Manifest} manifest
 * @returns {Promise<Session | null>} the ordinary session, if it succeeded and the server has accepted it
 */
async function measure(manifest) {
  const backend = backendFor(manifest, ready?.adapter);
  if (!ready || !backend) return null;
  const { adapter } = ready;
  const ordinary = !manifest.assigned?.length;
  hideNotice();
  stopped = false;
  probes.reset();
  if (ordinary) {
    element("result", HTMLElement).hidden = true;
    unsent = null;
  }
  asking.hidden = true;
  running.hidden = false;
  showBeginning();
  running.scrollIntoView({ block: "nearest" });
  if (ordinary) count("began");
  const wake = await navigator.wakeLock?.request("screen").catch(() => null);
  try {
    navigator.storage?.persist?.().catch(() => {}); // Firefox asks, and may never have an answer
    const order = await orderOf(manifest, backend, showDownload);
    const stated = await database.read("settings", "stated");
    const open = ordinary ? await sessions.resumable(manifest, backend) : null;
    const session = open ?? (await sessions.begin(manifest, await identify(adapter, stated ?? null)));
    return await measureIn(session, { ...order, done: session.runs, session: session.clock });
  } finally {
    running.hidden = true;
    showTitle(element("result", HTMLElement).hidden ? "" : element("speedup", HTMLElement).textContent);
    await wake?.release().catch(() => {});
  }
}

/**
 * Have the worker measure ORDER, and store finished runs in SESSION.
 * @param {Session} session
 * @param {any} order
 * @returns {Promise<Session | null>} the ordinary session, if it succeeded and the server has accepted it
 */
async function measureIn(session, order) {
  const course = new Course(order.protocol, session.runs.length);
  const last = await new Promise((resolve, reject) => {
    let silence = 0;
    const listen = (/** @type {number} */ limit) => {
      clearTimeout(silence);
      const detail = ngettext("It was silent for %(number)s minute.", "It was silent for %(number)s minutes.", limit / 60_000, {
        number: limit / 60_000,
      });
      silence = setTimeout(() => resolve({ type: "failed", code: "no_answer", detail }), limit);
    };
    worker = new Worker(new URL("worker.js", import.meta.url), { type: "module" });
    worker.onerror = (event) => reject(new Error(event.message || "the worker could not be loaded"));
    worker.onmessage = async ({ data }) => {
      listen(data.phase === "compiling" ? COMPILING_MS : FRAME_MS);
      try {
        if (data.type === "done" || data.type === "failed") resolve(data);
        else await took(session, data, course);
      } catch (error) {
        reject(error);
      }
    };
    listen(FRAME_MS);
    worker.postMessage(order);
    if (document.visibilityState === "hidden") worker.postMessage({ type: "stop" });
  }).finally(() => {
    worker?.terminate();
    worker = null;
    running.hidden = true;
  });
  const ordinary = !session.probes?.length;
  const failed = last.type === "failed";
  if (failed) {
    await sessions.end(session);
    const kept = session.runs.length ? gettext("Finished runs are kept.") : "";
    fail(last.code === "cannot_resume" ? "error" : last.code, last.detail, kept);
  } else if (last.interrupted) {
    if (!session.runs.length || !ordinary) await sessions.end(session);
    if (ordinary && !stopped) pausedAt = Date.now();
    sayInterrupted(session);
    showSessions(await sessions.all());
    if (ordinary) count("failed", stopped ? "stopped" : "hidden");
  } else {
    session.disturbed = last.disturbed;
    await sessions.end(session);
    if (ordinary) count("finished");
  }
  if (session.state !== "queued") return null;
  if (ordinary) {
    const accepted = await deliver(session);
    return failed ? null : accepted;
  }
  await sendWaiting();
  probes.thank(session);
  return null;
}

/**
 * Say why SESSION is interrupted, and what happens to its runs.
 * @param {Session} session
 */
function sayInterrupted({ runs, manifest, probes: assigned }) {
  if (assigned?.length) return say(gettext("Stopped"), runs.length ? gettext("Finished runs are sent.") : "");
  if (pausedAt) {
    return say(gettext("Paused: this page was hidden"), gettext("It continues as soon as you look at it, within half an hour."));
  }
  const planned = plannedRuns(manifest.protocol).length;
  if (!runs.length) return say(gettext("Stopped"), gettext("No run was finished, so nothing is kept."));
  say(
    gettext("Stopped: %(done)s of %(runs)s runs are kept", { done: runs.length, runs: planned }),
    gettext("Continue within half an hour, or erase them below. Otherwise they are sent at your next visit."),
  );
}

/**
 * @param {Session} session
 * @param {Message} message
 * @param {Course} course
 */
async function took(session, message, course) {
  if (message.type === "progress") showProgress(message, course);
  else if (message.type === "picture") draw(message);
  else if (message.type === "session") {
    const { type: _, ...clock } = message;
    session.clock = clock;
    await sessions.keep(session);
  } else if (message.type === "run") {
    session.runs.push(message.run);
    await sessions.keep(session);
    worker?.postMessage({ type: "next" });
  } else if (message.type === "repeated") {
    const replaced = new Set(message.replaced.map(({ id }) => id));
    session.runs = [...session.runs.filter(({ id }) => !replaced.has(id)), ...message.runs];
    session.blocksRepeated = (session.blocksRepeated ?? 0) + 1;
    await sessions.keep(session);
    worker?.postMessage({ type: "next" });
  }
}

/**
 * Show the result of SESSION, send it, and show the server's evaluation.
 * @param {Session} session
 * @returns {Promise<Session | null>} the session, where the server has accepted it
 */
async function deliver(session) {
  showResult(session, null, null);
  showRecommendation(null);
  unsent = session;
  await sendWaiting();
  const sent = (await sessions.all()).find(({ id }) => id === session.id) ?? session;
  return sent.answer && sent.state !== "rejected" ? sent : null;
}

/** The session whose result is shown before it was sent. @type {Session | null} */
let unsent = null;

/** Show the server's answer in the result, as soon as it was sent. */
async function updateResult() {
  const sent = unsent && (await sessions.all()).find(({ id }) => id === unsent?.id);
  if (!sent || sent.state === "queued") return;
  unsent = null;
  showResult(sent, null, null);
  if (!sent.answer) return;
  try {
    const state = await delivery.summaryOf(sent);
    const { application, front_version } = sent.manifest;
    const crowd = await askJson(
      `/speedups?${new URLSearchParams({ application, front: front_version, configuration: "best" })}`,
    );
    const recommended = state && (await probes.recommendation(application));
    const kept = (await sessions.all()).some(({ id }) => id === sent.id); // or erased meanwhile
    if (!kept || !running.hidden) return;
    showResult(sent, state, crowd.results);
    if (!state) return;
    sent.counts = element("result", HTMLElement).dataset.speedup !== "";
    await sessions.keep(sent);
    showSessions(await sessions.all());
    showRecommendation(recommended);
  } catch (error) {
    if (!(error instanceof Refusal || error instanceof UnreachableError)) throw error;
  }
}

element("sessions", HTMLElement).addEventListener("click", ({ target }) => {
  const id = target instanceof HTMLElement && target.dataset.session;
  if (id && running.hidden) showAgain(id).catch(showError);
});

/**
 * Show the result of an earlier session.
 * @param {string} id
 */
async function showAgain(id) {
  unsent = (await sessions.all()).find((session) => session.id === id) ?? null;
  if (!unsent) return;
  showResult(unsent, null, null);
  showRecommendation(null);
  element("result", HTMLElement).focus();
  await updateResult();
}

let nextSending = 0;

async function sendWaiting() {
  clearTimeout(nextSending);
  try {
    const pause = await delivery.sendAll();
    if (!pause) serverAnswered();
    if (pause > 0) nextSending = setTimeout(() => sendWaiting().catch(showError), Math.min(pause, LONGEST_TIMER_MS));
  } catch (error) {
    if (!(error instanceof delivery.StoppedError)) throw error;
    say(gettext("Not sent yet"), error.message, { untilSent: true });
    if (error.code === "consent_outdated" && ready) {
      ready.manifest = await readManifest();
      await showConsent();
    }
  }
  showSessions(await sessions.all());
  await showKey();
  const shown = await delivery.isModelShown();
  if (shown !== null) element("show-model", HTMLInputElement).checked = shown;
  await updateResult();
}

/** @param {unknown} error */
function showError(error) {
  if (error instanceof NotMeasurableError) return fail(error.code);
  if (error instanceof UnreachableError) return say(gettext("The server cannot be reached"), error.message, { untilSent: true });
  if (error instanceof database.StorageError) return say(gettext("Nothing can be stored"), error.message);
  if (error instanceof DamagedError) {
    return say(gettext("The download arrived damaged"), gettext("Load this page again."), { detail: error.message });
  }
  if (error instanceof Refusal) {
    const { temporary, code, message: detail } = error;
    if (temporary) return say(gettext("The server is busy"), gettext("Try again in a minute."), { detail });
    if (code === "no_front") {
      return say(gettext("Nothing to measure yet"), gettext("This server has not published anything to measure."));
    }
    return say(gettext("This did not work"), gettext("The server refused the request."), { detail });
  }
  fail("error", error instanceof Error ? error.message : String(error));
}

// The owner's actions.

element("export", HTMLButtonElement).addEventListener("click", () => save().catch(showError));
element("erase", HTMLButtonElement).addEventListener("click", () => {
  if (window.confirm(gettext("Erase everything that was measured here, on this device and on the server? It cannot be undone."))) {
    erase().catch(showError);
  }
});

/** Offer all stored data as a download. */
async function save() {
  saveFile("frontrunner-measurements.json", "application/json", JSON.stringify(await delivery.exported(), null, 2));
}

async function erase() {
  await delivery.erase();
  element("result", HTMLElement).hidden = true;
  showTitle("");
  probes.reset();
  hideNotice();
  if (await delivery.isErasing()) {
    say(gettext("Erased on this device"), gettext("The server erases its copy as soon as this page can reach it."), { untilSent: true });
  } else {
    say(gettext("Erased here and on the server"), gettext("Copies that others downloaded before may still exist."));
  }
  showSessions(await sessions.all());
  await showKey();
  await showConsent();
}

element("show-model", HTMLInputElement).addEventListener("change", async ({ currentTarget }) => {
  const box = /** @type {HTMLInputElement} */ (currentTarget);
  await delivery.showModel(box.checked).catch((error) => {
    box.checked = !box.checked;
    showError(error);
  });
});

onStated(showConsent);

window.addEventListener("online", () => {
  delivery.endPause().then(() => (ready ? sendWaiting() : open())).catch(showError);
});

/** Cache what this page loaded, so that it opens without a network. */
async function keepOffline() {
  if (!("serviceWorker" in navigator)) return;
  await navigator.serviceWorker.register(new URL("service-worker.js", import.meta.url));
  const registration = await navigator.serviceWorker.ready;
  const loaded = performance.getEntriesByType("resource").map(({ name }) => name);
  const later = WORKER_FILES.map((name) => String(new URL(name, import.meta.url)));
  registration.active?.postMessage({ type: "keep", urls: [location.href, location.origin + location.pathname, ...loaded, ...later] });
}

async function open() {
  checking.hidden = false;
  await prepare().finally(() => (checking.hidden = true));
  count("opened");
  await sendWaiting();
}

keepOffline().catch(() => {}); // an offline page is a convenience
open().catch(showError);
