/** The notice of the page, and the reasons why a browser does not measure. */

import { element } from "./elements.js";
import { gettext } from "./language.js";

const notice = element("notice", HTMLElement);
const again = element("again", HTMLButtonElement);

/** Remedies where a browser cannot measure. */
export const REASONS = {
  insecure: [
    gettext("This address has no HTTPS"),
    gettext("Browsers measure on secure pages only. Open this page over https://, or on the server's own machine as http://localhost."),
  ],
  no_wasm_simd: [
    gettext("This browser is too old to measure"),
    gettext("It has neither WebGPU nor WebAssembly with SIMD. Update it: Chrome has that since version 91, Firefox since 89, Safari since 16.4."),
  ],
  wrong_results: [
    gettext("This device computes wrong results"),
    gettext("Its browser or graphics driver gives wrong results, so nothing was timed. The server only counts such cases, by the maker of the graphics chip and the browser. An update may help."),
  ],
  device_lost: [
    gettext("The graphics device was lost"),
    gettext("The browser took it away twice. Close other programs and start again."),
  ],
  no_answer: [
    gettext("The device stopped answering"),
    gettext("Close other programs and load this page again. Another browser may do better."),
  ],
  error: [gettext("The measurement ended with an error"), ""],
};

export class NotMeasurableError extends Error {
  /** @param {"insecure" | "no_wasm_simd"} code */
  constructor(code) {
    super(REASONS[code][0]);
    this.code = code;
  }
}

/**
 * Show a notice in place of the page's content.
 * @param {string} title
 * @param {string} text
 * @param {{untilSent?: boolean, detail?: string, final?: boolean}} [more] `untilSent`: it goes as soon as the server
 *   answers; `detail`: for someone who reports it; `final`: another try would end alike
 */
export function say(title, text, { untilSent = false, detail = "", final = false } = {}) {
  notice.dataset.untilSent = String(untilSent);
  element("notice-title", HTMLElement).textContent = title;
  element("notice-text", HTMLElement).textContent = text;
  element("notice-detail", HTMLElement).textContent = detail;
  element("notice-browsers", HTMLElement).hidden = true;
  again.hidden = final;
  notice.hidden = false;
}

again.addEventListener("click", () => location.reload());

/** Hide the notice. */
export function hideNotice() {
  notice.hidden = true;
}

/** Hide a notice that goes as soon as the server answers. */
export function serverAnswered() {
  if (notice.dataset.untilSent === "true") hideNotice();
}
