/** Probes: configurations that the server assigns to this device after an ordinary session. */

import * as database from "./database.js";
import { element } from "./elements.js";
import { gettext, ngettext } from "./language.js";
import { Refusal, UnreachableError, askJson } from "./server.js";

const MINUTES = 2;

const section = element("probes", HTMLElement);
const button = element("measure-probes", HTMLButtonElement);
const thanks = element("thanks", HTMLElement);

/** @typedef {import("./server.js").Manifest} Manifest */
/** @typedef {import("./sessions.js").Session} Session */

/**
 * The answer of PATH for this browser's installation; null without an installation or an answer.
 * @param {string} path
 * @param {Record<string, string>} query
 * @returns {Promise<any>}
 */
async function askAsInstallation(path, query) {
  const installation = await database.read("settings", "installation");
  if (!installation) return null;
  try {
    return await askJson(`${path}?${new URLSearchParams(query)}`, { token: installation.token });
  } catch (error) {
    if (error instanceof Refusal || error instanceof UnreachableError) return null;
    throw error;
  }
}

/**
 * The manifest of this device's probes; null where the server assigns none. It is not stored.
 * @param {string} application
 * @returns {Promise<Manifest | null>}
 */
export async function assignedManifest(application) {
  const manifest = await askAsInstallation("/manifest", { application, minutes: String(MINUTES) });
  return manifest?.assigned?.length ? manifest : null;
}

/**
 * The server's recommendation for this device, or null.
 * @param {string} application
 * @returns {Promise<any>}
 */
export function recommendation(application) {
  return askAsInstallation("/recommendation", { application });
}

/**
 * Show the assigned probes with the reasons. PRESSED is called once, when the visitor agrees.
 * @param {Manifest} manifest
 * @param {() => void} pressed
 */
export function offer({ assigned = [] }, pressed) {
  const rows = assigned.map(({ name, why }) => {
    const row = document.createElement("li");
    row.textContent = gettext("%(name)s: %(why)s", { name, why: gettext(why) });
    return row;
  });
  element("assigned", HTMLElement).replaceChildren(...rows);
  const number = assigned.length;
  button.textContent = ngettext("Measure %(number)s more", "Measure %(number)s more", number, { number });
  button.onclick = () => {
    section.hidden = true;
    pressed();
  };
  section.hidden = false;
}

/** Another measurement begins: hide the offer and the thanks. */
export function reset() {
  section.hidden = true;
  thanks.hidden = true;
}

/**
 * The probes that SESSION has runs of.
 * @param {Session} session
 * @param {boolean} [ok] whether only runs count that did not fail
 * @returns {string[]} their names
 */
export function probesOf({ runs, probes = [] }, ok = false) {
  return probes.filter((name) => runs.some((run) => run.configuration === name && (!ok || run.status === "ok")));
}

/**
 * Say thanks for a session of probes.
 * @param {Session} session
 */
export function thank(session) {
  const names = probesOf(session, true);
  const most = { first: names.slice(0, -1).join(", "), last: names.at(-1) ?? "" };
  const words = names.length > 1 ? gettext("%(first)s and %(last)s", most) : names[0];
  thanks.textContent = words
    ? gettext("Thank you: predictions now include %(words)s on this device.", { words })
    : gettext("No probe ran on this device.");
  thanks.hidden = false;
}
