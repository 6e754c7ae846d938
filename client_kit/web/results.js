/** The results of a session on the page, shown to its owner before the server has processed them. */

import { element } from "./elements.js";
import { probesOf } from "./probes.js";
import { meanSeconds, speedupOf, stageSeconds } from "./speedup.js";

/** @typedef {import("./sessions.js").Session} Session */
/** @typedef {import("./run-record.js").Run} Run */

const SHOWN = ["default", "best", "adaptive"]; // adaptive where the front has it: it leaves out frames
const STATES = {
  measuring: "in progress",
  queued: "kept here, not sent yet",
  accepted: "sent",
  duplicate: "sent",
  rejected: "refused by the server",
};

/**
 * A new element with a class and with CONTENT, as text where it is one.
 * @param {string} tag
 * @param {string} style
 * @param {...(string | Node)} content
 * @returns {HTMLElement}
 */
function made(tag, style, ...content) {
  const created = document.createElement(tag);
  if (style) created.className = style;
  created.append(...content);
  return created;
}

/**
 * @param {number} value
 * @returns {string} 12.3 or 4.56: three digits
 */
function digits(value) {
  return value >= 100 ? value.toFixed(0) : value.toPrecision(3);
}

/**
 * Show SESSION's result. STATE is the server's answer about it, CROWD its rows of /speedups; both null before that.
 * @param {Session} session
 * @param {any} state
 * @param {any[] | null} crowd
 */
export function showResult(session, state, crowd) {
  const { protocol } = session.manifest;
  const result = element("result", HTMLElement);
  const first = result.hidden;
  const speedup = speedupOf(session.runs, "best", protocol, session.bands);
  const own = crowd?.find(({ device, backend }) => device === state?.device && backend === session.clock?.backend);
  const judged = state?.sessions?.flatMap((/** @type {any} */ row) => row.speedups)
    .find((/** @type {any} */ row) => row.configuration === "best");
  const standing = judged && judged.state !== "valid" ? judged.state : (own?.state ?? null);
  result.dataset.state = standing ?? (session.answer ? "sent" : "kept");

  const counts = standing === null || standing === "unconfirmed" || standing === "confirmed";
  result.dataset.speedup = speedup && counts ? String(speedup.value) : "";
  element("result-title", HTMLElement).textContent = speedup && counts ? titleOf(speedup.value) : "This measurement does not count";
  element("speedup", HTMLElement).textContent = speedup && counts ? `${digits(speedup.value)}×` : "";
  element("interval", HTMLElement).textContent = intervalOf(session, speedup);
  element("rates", HTMLElement).replaceChildren(...SHOWN.flatMap((name) => rateOf(session, name)));
  element("stages", HTMLElement).replaceChildren(...SHOWN.flatMap((name) => barOf(session, name)));
  element("standing", HTMLElement).textContent = standingOf(session, standing, judged?.reason ?? "", speedup?.value, own, crowd);
  element("links", HTMLElement).replaceChildren(...linksOf(state));
  result.hidden = false;
  if (first) result.focus();
}

/**
 * Show the server's recommendation for this device, if any.
 * @param {any} recommendation
 */
export function showRecommendation(recommendation) {
  const line = element("recommendation", HTMLElement);
  line.hidden = !recommendation;
  if (!recommendation) return;
  const { configuration, predicted: { ratio, low, high }, state } = recommendation;
  const interval = state === "predicted" && low && high ? `, 95 % interval ${digits(low)}× to ${digits(high)}×` : "";
  line.replaceChildren(
    `Best for this device within 5 cm: ${configuration}, ${digits(ratio)}× (${state}${interval}). `,
    link("/recommend/", "Recommendations for other devices"),
  );
}

/**
 * @param {Session} session
 * @param {import("./speedup.js").Speedup | null} speedup
 * @returns {string}
 */
function intervalOf({ runs }, speedup) {
  if (!speedup) {
    const failed = runs.find(({ failure }) => failure);
    return failed ? `${failed.configuration}: ${failed.failure}` : "No speedup: it takes a complete run of default and one of best.";
  }
  if (speedup.low === null || speedup.high === null) return "Too few pairs of runs for an interval.";
  const interval = `95 % interval of this session: ${digits(speedup.low)}× to ${digits(speedup.high)}×, from ${speedup.pairs} pairs of runs.`;
  return speedup.changed ? `${interval} The speedup changed while it was measured, so it does not count.` : interval;
}

/**
 * Frames a second of a configuration.
 * @param {Session} session
 * @param {string} name
 * @returns {HTMLElement[]}
 */
function rateOf({ runs, manifest, bands }, name) {
  const first = manifest.protocol.first_counted_frame;
  const good = runs.filter(({ configuration, status }) => configuration === name && status === "ok");
  if (!good.length) return [];
  const seconds = good.reduce((sum, run) => sum + meanSeconds(run, manifest.protocol), 0) / good.length;
  const rate = made("dd", "value small", `${digits(1 / seconds)} frames a second`);
  let note = `${digits(1000 * seconds)} ms a frame`;
  if (name === "adaptive") {
    const counted = good.flatMap(({ tracked }) => tracked.slice(first));
    const skipped = counted.filter((tracked) => tracked === null).length / counted.length;
    const speedup = speedupOf(runs, name, manifest.protocol, bands);
    if (speedup) note += `, ${digits(speedup.value)}×`;
    note += `; adapts, ${Math.round(100 * skipped)} % of frames skipped`;
  }
  return [made("div", "", made("dt", `key key-${name}`, name), rate, made("dd", "note", note))];
}

/**
 * A configuration's stages, as parts of its frame; empty where no clock measured them.
 * @param {Session} session
 * @param {string} name
 * @returns {HTMLElement[]}
 */
function barOf({ runs, manifest }, name) {
  const good = runs.filter(({ configuration, status }) => configuration === name && status === "ok");
  /** @type {Record<string, number>} */
  const sums = {};
  for (const run of good) {
    for (const [stage, seconds] of Object.entries(stageSeconds(run, manifest.protocol))) {
      sums[stage] = (sums[stage] ?? 0) + seconds / good.length;
    }
  }
  const total = Object.values(sums).reduce((sum, seconds) => sum + seconds, 0);
  if (!total) return [];
  const bar = made("div", "stage-bar");
  const words = [];
  for (const [stage, seconds] of Object.entries(sums)) {
    const part = made("span", `stage-${stage}`);
    part.style.width = `${(100 * seconds) / total}%`;
    bar.append(part);
    words.push(`${stage} ${digits(1000 * seconds)} ms`);
  }
  bar.setAttribute("aria-hidden", "true");
  return [made("p", "", made("span", `key key-${name}`, name), `: ${words.join(", ")}`), bar];
}

/**
 * The state of the session as a sentence.
 * @param {Session} session
 * @param {string | null} standing
 * @param {string} reason
 * @param {number | undefined} speedup
 * @param {any} own
 * @param {any[] | null} crowd
 * @returns {string}
 */
function standingOf(session, standing, reason, speedup, own, crowd) {
  if (session.state === "rejected") return `The server refused this session: ${session.reason}`;
  if (!session.answer) return "Stored on this device. It is sent as soon as the server can be reached.";
  if (!standing) return "Sent. The server is still processing it.";
  if (standing !== "unconfirmed" && standing !== "confirmed") return wordsOf(reason);
  const others = (crowd ?? []).filter((row) => row.backend === session.clock?.backend && row !== own);
  const way = session.clock?.backend === "wasm" ? "WebAssembly" : "WebGPU";
  const faster = others.filter((row) => row.speedup > (speedup ?? 0)).length;
  const place = others.length
    ? `Your device gains more than ${others.length - faster} of ${others.length} other devices measured by ${way}.`
    : `No other device was measured by ${way} yet.`;
  const confirmed = standing === "confirmed" ? "The figure is confirmed." : "The figure is public and marked as unconfirmed until independent devices agree.";
  return `${place} ${confirmed}`;
}

/**
 * @param {number} speedup
 * @returns {string}
 */
function titleOf(speedup) {
  const [times, word] = speedup < 1 ? [1 / speedup, "slower"] : [speedup, "faster"];
  return `The tuned version runs ${digits(times)} times ${word} on this device`;
}

/**
 * Why a session does not count, and what to do.
 * @param {string} reason the server's code
 * @returns {string}
 */
function wordsOf(reason) {
  const rules = JSON.parse(document.getElementById("rules")?.textContent ?? "{}");
  const why = rules[reason] ?? "the server set it aside";
  return `It was sent, but is in no figure: ${why}. Close other programs, let the device cool, and measure again.`;
}

/**
 * @param {any} state
 * @returns {HTMLElement[]}
 */
function linksOf(state) {
  const links = [];
  if (state?.device) {
    const address = `/devices/${state.device}/`;
    const share = made("button", "", "Share");
    share.addEventListener("click", () => shared(share, new URL(address, location.href).href));
    links.push(link(address, "This device among the others"), share);
  }
  if (state?.page) {
    const note = made("small", "", " (anyone with its address can read it)");
    links.push(made("span", "", link(state.page, "Your private page"), note));
  }
  return links;
}

/**
 * @param {string} address
 * @param {string} text
 * @returns {HTMLElement}
 */
function link(address, text) {
  const anchor = made("a", "", text);
  anchor.setAttribute("href", address);
  return anchor;
}

/**
 * Share ADDRESS with the platform's dialogue, or copy it.
 * @param {HTMLElement} button
 * @param {string} address
 */
async function shared(button, address) {
  try {
    if (navigator.share) await navigator.share({ title: "Frontrunner", url: address });
    else {
      await navigator.clipboard.writeText(address);
      button.textContent = "Link copied";
    }
  } catch {
    // The owner closed the dialogue, or the browser does not permit it: the link is beside the button.
  }
}

/**
 * @param {Session} session
 * @returns {string} the outcome of SESSION, in a word or two
 */
function valueOf(session) {
  if (session.probes?.length) {
    const { length } = probesOf(session);
    return length === 1 ? "1 probe" : `${length} probes`;
  }
  if (session.counts === false) return "does not count";
  const speedup = speedupOf(session.runs, "best", session.manifest.protocol, session.bands);
  return speedup ? `${digits(speedup.value)}×` : "no speedup";
}

/**
 * List the sessions of this browser.
 * @param {Session[]} all
 */
export function showSessions(all) {
  const rows = all
    .filter(({ state }) => state !== "measuring")
    .map((session) => {
      const when = made("time", "", new Date(session.startedAt).toLocaleString());
      when.setAttribute("datetime", session.startedAt);
      const value = made("span", "value", valueOf(session));
      const reason = session.state === "accepted" || !session.reason ? "" : `: ${session.reason}`;
      return made("li", "", when, value, made("small", "", `${session.manifest.front_version}, ${STATES[session.state]}${reason}`));
    });
  element("sessions", HTMLElement).replaceChildren(...rows);
  element("mine", HTMLElement).hidden = !rows.length;
}
