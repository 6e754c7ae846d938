/** The worker of /measure/: it runs the page's orders (see client_kit/web/measurement.js). */

import { measure } from "./measurement.js";

/** @typedef {import("./measurement.js").Order} Order */
/** @typedef {{type: "measure"} & Order | {type: "next"} | {type: "stop"}} Request */

const stopping = new AbortController();
let stored = () => {};

self.addEventListener("message", ({ data }) => {
  const request = /** @type {Request} */ (data);
  if (request.type === "next") stored();
  else if (request.type === "stop") stopping.abort();
  else {
    measure(request, {
      gpu: navigator.gpu,
      send: (message, transfer = []) => self.postMessage(message, { transfer }),
      stored: () => new Promise((resolve) => (stored = resolve)),
      signal: stopping.signal,
    });
  }
});
