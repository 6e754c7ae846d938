/** What the page shows while it measures: the step, one bar, the time that is left, and the picture. */

import { nameOf } from "./names.js";
import { element, showTitle } from "./elements.js";
import { gettext, megabytes, ngettext } from "./language.js";

/** @typedef {import("./measurement.js").Message} Message */
/** @typedef {import("./course.js").Course} Course */

const left = element("left", HTMLElement);
const step = element("step", HTMLElement);
const progress = element("progress", HTMLProgressElement);
const picture = element("picture", HTMLCanvasElement);
const caption = element("caption", HTMLElement);

const DOWNLOAD = 0.2; // of the bar, where the recording is not here yet

let measuringFrom = 0; // of the bar
let downloadingSince = 0; // milliseconds

/** Show that something begins, of which nothing is known yet. */
export function showBeginning() {
  progress.removeAttribute("value");
  step.textContent = "";
  caption.textContent = "";
  picture.getContext("2d")?.clearRect(0, 0, picture.width, picture.height);
  left.textContent = "";
  measuringFrom = 0;
}

/**
 * @param {number} done bytes of the recording that were not here
 * @param {number} total
 */
export function showDownload(done, total) {
  if (!done) downloadingSince = performance.now();
  measuringFrom = DOWNLOAD;
  progress.value = (DOWNLOAD * done) / total;
  step.textContent = gettext("Downloading the recording: %(loaded)s of %(all)s MB", {
    loaded: megabytes(done), all: megabytes(total),
  });
  const number = tens(((performance.now() - downloadingSince) / 1000) * (total / done - 1));
  left.textContent = done ? gettext("It measures in about %(number)s seconds", { number }) : "";
}

/**
 * @param {Extract<Message, {type: "progress"}>} message
 * @param {Course} course
 */
export function showProgress(message, course) {
  const { phase, configuration, run, runs, frame, frames } = message;
  const name = nameOf(configuration);
  const again = course.again(run);
  const words = {
    compiling: gettext("Compiling for this device: %(frame)s of %(frames)s", { frame, frames }),
    preparing: gettext("Preparing the recording"),
    checking: gettext("Checking what this device computes: %(name)s", { name }),
    measuring: again
      ? gettext("Second try, as another program used this device: run %(run)s of %(runs)s", again)
      : gettext("Run %(run)s of %(runs)s: %(name)s", { run, runs, name }),
  }[phase];
  if (step.textContent !== words) step.textContent = words;
  const { share, seconds } = course.at(message, performance.now() / 1000);
  progress.value = measuringFrom + (1 - measuringFrom) * share;
  showTitle(`${Math.floor(100 * progress.value)} %`);
  left.textContent = seconds === null ? "" : minutes(seconds);
}

/**
 * @param {number} seconds
 * @returns {number} rounded up to tens
 */
function tens(seconds) {
  return Math.max(10, 10 * Math.ceil(seconds / 10));
}

/**
 * @param {number} seconds
 * @returns {string}
 */
function minutes(seconds) {
  if (seconds < 50) {
    return gettext("About %(number)s seconds left", { number: tens(seconds) });
  }
  const whole = Math.max(1, Math.round(seconds / 60));
  return ngettext("About a minute left", "About %(number)s minutes left", whole, { number: whole });
}

/** @param {Extract<Message, {type: "picture"}>} message */
export function draw({ width, height, pixels, configuration }) {
  caption.textContent = gettext("Reconstructed by %(name)s", { name: nameOf(configuration) });
  picture.width = width;
  picture.height = height;
  picture.getContext("2d")?.putImageData(new ImageData(pixels, width, height), 0, 0);
}
