/** The results of a session on the page, shown to its owner before the server has processed them. */

import { nameOf, nameOfStage } from "./names.js";
import { element, showTitle } from "./elements.js";
import { decimal, gettext, locale, ngettext } from "./language.js";
import { probesOf } from "./probes.js";
import { plannedRuns } from "./schedule.js";
import { isWide, meanSeconds, slowedDown, speedupOf, stageSeconds } from "./speedup.js";

/** @typedef {import("./sessions.js").Session} Session */
/** @typedef {import("./run-record.js").Run} Run */
/** @typedef {import("./speedup.js").Speedup} Speedup */

const SHOWN = ["default", "best", "adaptive"]; // adaptive where the front has it: it leaves out frames
const STATES = {
  measuring: gettext("not finished"),
  queued: gettext("kept here, not sent yet"),
  accepted: gettext("sent"),
  duplicate: gettext("sent"),
  rejected: gettext("refused by the server"),
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
  return decimal(value >= 100 ? value.toFixed(0) : value.toPrecision(3));
}

/**
 * @param {Speedup} speedup
 * @returns {string} its number, or its interval where that is too wide for one
 */
function timesOf(speedup) {
  return isWide(speedup) ? `${digits(speedup.low)}–${digits(speedup.high)}×` : `${digits(speedup.value)}×`;
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
  const title = speedup && counts ? titleOf(speedup) : "";
  element("result-title", HTMLElement).textContent = title || gettext("This measurement does not count");
  element("speedup", HTMLElement).textContent = speedup && counts ? timesOf(speedup) : "";
  element("speedup", HTMLElement).classList.toggle("range", speedup !== null && isWide(speedup));
  showTitle(element("speedup", HTMLElement).textContent);
  element("interval", HTMLElement).textContent = intervalOf(session, speedup);
  element("rates", HTMLElement).replaceChildren(...SHOWN.flatMap((name) => rateOf(session, name)));
  element("stages", HTMLElement).replaceChildren(...SHOWN.flatMap((name) => barOf(session, name)));
  element("standing", HTMLElement).textContent = standingOf(session, standing, judged?.reason ?? "", speedup, own, crowd);
  element("links", HTMLElement).replaceChildren(...linksOf(state, title));
  result.hidden = false;
  if (first) result.focus();
}

/**
 * Show the server's recommendation for this device, if any, and unless it rests on a speedup that is shown as a range.
 * @param {any} recommendation
 */
export function showRecommendation(recommendation) {
  const line = element("recommendation", HTMLElement);
  const withheld = recommendation?.state === "measured" && element("speedup", HTMLElement).classList.contains("range");
  line.hidden = !recommendation || withheld;
  if (line.hidden) return;
  const { configuration, predicted: { ratio, low, high }, state } = recommendation;
  const between = state === "predicted" && low && high;
  const interval = between
    ? gettext(", 95 % interval %(low)s× to %(high)s×", { low: digits(low), high: digits(high) })
    : "";
  const basis = { measured: gettext("measured"), predicted: gettext("predicted") }[/** @type {string} */ (state)] ?? state;
  const best = { name: nameOf(configuration), ratio: digits(ratio), basis: `${basis}${interval}` };
  line.replaceChildren(
    `${gettext("Best on this device with at most 5 cm of error: %(name)s, %(ratio)s× (%(basis)s).", best)} `,
    configuration === "adaptive" ? `${gettext("It leaves out frames while the camera hardly moves.")} ` : "",
    link("/recommend/", gettext("Recommendations for other devices")),
  );
}

/**
 * @param {Session} session
 * @param {Speedup | null} speedup
 * @returns {string}
 */
function intervalOf({ runs, manifest, disturbed }, speedup) {
  if (!speedup) {
    const failed = runs.find(({ failure }) => failure);
    return failed ? `${failed.configuration}: ${failed.failure}` : gettext("No speedup: it takes a complete run of default and one of best.");
  }
  if (speedup.low === null || speedup.high === null) return gettext("Too few pairs of runs for an interval.");
  const { pairs } = speedup;
  const interval = ngettext(
    "Between %(low)s× and %(high)s×: the 95 % interval from %(pairs)s pair of runs.",
    "Between %(low)s× and %(high)s×: the 95 % interval from %(pairs)s pairs of runs.",
    pairs, { low: digits(speedup.low), high: digits(speedup.high), pairs },
  );
  const wide = isWide(speedup) ? [gettext("The runs differ too much to give one number.")] : [];
  const changed = speedup.changed ? [gettext("The speedup changed while it was measured, so it does not count.")] : [];
  const busy = disturbed ? [gettext("The device was busy: close other programs and measure again.")] : [];
  const slower = slowedDown(runs, manifest.protocol);
  const slow = slower === null ? [] : [
    gettext("The processor was slower for a while: the later runs took %(share)s % longer.", { share: Math.round(100 * (slower - 1)) }),
  ];
  return [interval, ...wide, ...changed, ...busy, ...slow].join(" ");
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
  const rate = made("dd", "value small", gettext("%(rate)s frames a second", { rate: digits(1 / seconds) }));
  let note = gettext("%(time)s ms a frame", { time: digits(1000 * seconds) });
  if (name === "adaptive") {
    const counted = good.flatMap(({ tracked }) => tracked.slice(first));
    const skipped = counted.filter((tracked) => tracked === null).length / counted.length;
    const speedup = speedupOf(runs, name, manifest.protocol, bands);
    if (speedup) note += `, ${timesOf(speedup)}`;
    note += gettext(", %(share)s % of frames left out", { share: Math.round(100 * skipped) });
  }
  return [made("div", "", made("dt", `key key-${name}`, nameOf(name)), rate, made("dd", "note", note))];
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
    words.push(`${nameOfStage(stage)} ${digits(1000 * seconds)} ms`);
  }
  bar.setAttribute("aria-hidden", "true");
  return [made("p", "", made("span", `key key-${name}`, nameOf(name)), ` ${words.join(", ")}`), bar];
}

/**
 * The state of the session as a sentence.
 * @param {Session} session
 * @param {string | null} standing
 * @param {string} reason
 * @param {Speedup | null} speedup
 * @param {any} own
 * @param {any[] | null} crowd
 * @returns {string}
 */
function standingOf(session, standing, reason, speedup, own, crowd) {
  if (session.state === "rejected") return gettext("The server refused this session: %(reason)s", { reason: session.reason ?? "" });
  if (!session.answer) return gettext("Stored on this device. It is sent as soon as the server can be reached.");
  if (!standing) return gettext("Sent. The server is still processing it.");
  if (standing !== "unconfirmed" && standing !== "confirmed") return wordsOf(reason);
  const confirmed = standing === "confirmed" ? gettext("The figure is confirmed.") : gettext("The figure is public and marked as unconfirmed until independent devices agree.");
  if (!speedup || isWide(speedup)) return confirmed;
  const others = (crowd ?? []).filter((row) => row.backend === session.clock?.backend && row !== own);
  const way = session.clock?.backend === "wasm" ? "WebAssembly" : "WebGPU";
  const slower = others.length - others.filter((row) => row.speedup > speedup.value).length;
  return `${placeAmong(others.length, slower, way)} ${confirmed}`;
}

/**
 * The place of this device among OTHERS kinds of devices, of which SLOWER gain less.
 * @param {number} others
 * @param {number} slower
 * @param {string} way of measuring
 * @returns {string}
 */
function placeAmong(others, slower, way) {
  if (!others) return gettext("It is the first kind of device that was measured by %(way)s.", { way });
  if (others > 1) {
    return gettext("The gain is larger here than on %(slower)s of %(others)s other kinds of devices measured by %(way)s.", {
      slower, others, way,
    });
  }
  return slower
    ? gettext("The gain is larger here than on the one other kind of device measured by %(way)s.", { way })
    : gettext("The gain is smaller here than on the one other kind of device measured by %(way)s.", { way });
}

/**
 * @param {Speedup} speedup
 * @returns {string}
 */
function titleOf(speedup) {
  const { value } = speedup;
  if (isWide(speedup)) {
    const range = { low: digits(speedup.low), high: digits(speedup.high) };
    return gettext("The tuned version runs %(low)s to %(high)s times as fast on this device", range);
  }
  return value < 1
    ? gettext("The tuned version runs %(times)s times slower on this device", { times: digits(1 / value) })
    : gettext("The tuned version runs %(times)s times faster on this device", { times: digits(value) });
}

/**
 * Why a session does not count, and what to do.
 * @param {string} reason the server's code
 * @returns {string}
 */
function wordsOf(reason) {
  const rules = JSON.parse(document.getElementById("rules")?.textContent ?? "{}");
  const why = rules[reason] ?? gettext("the server set it aside");
  return gettext("It was sent, but is in no figure: %(why)s. Close other programs, and measure again.", { why });
}

/**
 * @param {any} state
 * @param {string} text the result in a sentence, for those with whom it is shared
 * @returns {HTMLElement[]}
 */
function linksOf(state, text) {
  const links = [];
  if (state?.device) {
    const address = `/devices/${state.device}/`;
    const share = made("button", "", gettext("Share"));
    share.addEventListener("click", () => shared(share, text, new URL(address, location.href).href));
    links.push(link(address, gettext("This device among the others")), share);
  }
  if (state?.page) links.push(link(state.page, gettext("Your private page"))); // which says who can read it
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
 * Share TEXT and ADDRESS with the platform's dialogue, or copy them.
 * @param {HTMLElement} button
 * @param {string} text
 * @param {string} address
 */
async function shared(button, text, address) {
  try {
    if (navigator.share) await navigator.share({ title: "Frontrunner", text, url: address });
    else {
      await navigator.clipboard.writeText(`${text}\n${address}`.trim());
      button.textContent = gettext("Copied");
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
  if (session.state === "measuring") {
    const runs = plannedRuns(session.manifest.protocol).length;
    return gettext("%(done)s of %(runs)s runs", { done: session.runs.length, runs });
  }
  if (session.probes?.length) {
    const { length } = probesOf(session);
    return ngettext("%(number)s probe", "%(number)s probes", length, { number: length });
  }
  if (session.counts === false) return gettext("does not count");
  const speedup = speedupOf(session.runs, "best", session.manifest.protocol, session.bands);
  return speedup ? timesOf(speedup) : gettext("no speedup");
}

/**
 * Whether SESSION's result can be shown.
 * @param {Session} session
 * @returns {boolean}
 */
function opens({ state, probes }) {
  return state !== "measuring" && !probes?.length;
}

/**
 * List the sessions of this browser. A button with `data-session` shows the result of its session.
 * @param {Session[]} all
 */
export function showSessions(all) {
  const rows = all
    .filter(({ state, runs }) => state !== "measuring" || runs.length)
    .map((session) => {
      const when = made("time", "", new Date(session.startedAt).toLocaleString(locale));
      when.setAttribute("datetime", session.startedAt);
      const value = made(opens(session) ? "button" : "span", "value", valueOf(session));
      if (opens(session)) value.dataset.session = session.id;
      const reason = session.state === "accepted" || !session.reason ? "" : ` (${session.reason})`;
      return made("li", "", when, value, made("small", "", `${session.manifest.front_version}, ${STATES[session.state]}${reason}`));
    });
  element("sessions", HTMLElement).replaceChildren(...rows);
  element("mine", HTMLElement).hidden = !rows.length;
}
