/** The key to what was measured here, as a link that its owner keeps: by clipboard, as a file, as a bookmark. */

import * as delivery from "./delivery.js";
import { element } from "./elements.js";
import { saveFile } from "./files.js";
import { gettext } from "./language.js";

const keyLink = element("key-link", HTMLAnchorElement);

/** Show how to keep the key, as soon as there is one. */
export async function showKey() {
  const tokens = await delivery.tokens();
  element("key", HTMLElement).hidden = !tokens.length;
  keyLink.href = `/measure/key/#${tokens.join(",")}`;
}

element("copy-key", HTMLButtonElement).addEventListener("click", async ({ currentTarget }) => {
  await navigator.clipboard.writeText(keyLink.href).then(
    () => (/** @type {HTMLButtonElement} */ (currentTarget).textContent = gettext("Link copied")),
    () => {}, // not permitted: the link itself is there
  );
});
element("save-key", HTMLButtonElement).addEventListener("click", () => {
  const text = gettext("The key to what you measured for %(host)s. Open this address to export or erase it.", {
    host: location.host,
  });
  const warning = gettext("Anyone who has the address can do so.");
  saveFile("frontrunner-key.txt", "text/plain", `${text}\n${warning}\n\n${keyLink.href}\n`);
});
