/** The page /measure/key/#TOKEN,TOKEN: what was sent under these tokens can be exported and erased, in any browser. */

import { element } from "./elements.js";
import { saveFile } from "./files.js";
import { gettext } from "./language.js";
import { Refusal, UnreachableError, ask, askJson } from "./server.js";

const QUESTION = gettext("Erase everything that was sent with this key? It cannot be undone.");

const notice = element("notice", HTMLElement);
const own = element("own", HTMLElement);
const pages = element("pages", HTMLElement);

/** The tokens that the server knows. @type {string[]} */
let known = [];

/** @param {string} text */
function say(text) {
  notice.textContent = text;
  notice.hidden = false;
}

/** @param {unknown} error */
function showError(error) {
  const message = error instanceof Error ? error.message : String(error);
  say(error instanceof UnreachableError ? `${gettext("The server cannot be reached.")} ${message}` : message);
}

async function open() {
  const tokens = location.hash.slice(1).split(",").filter(Boolean);
  const links = [];
  for (const other of document.querySelectorAll("a[hreflang]")) /** @type {HTMLAnchorElement} */ (other).hash = location.hash;
  known = [];
  own.hidden = true;
  for (const token of tokens) {
    try {
      const { page } = await askJson("/me", { token });
      known.push(token);
      const link = document.createElement("a");
      link.href = page;
      link.textContent = gettext("What was sent");
      links.push(link);
    } catch (error) {
      if (!(error instanceof Refusal) || error.status !== 401) throw error;
    }
  }
  if (!tokens.length) return say(gettext("This address has no key after its #. Open the whole link that you kept."));
  if (!known.length) return say(gettext("Nothing is stored under this key: it was erased, or the key was replaced."));
  notice.hidden = true;
  pages.replaceChildren(...links);
  own.hidden = false;
}

async function save() {
  const servers = [];
  for (const token of known) servers.push(await askJson("/me/data", { token }));
  saveFile("frontrunner-measurements.json", "application/json", JSON.stringify(servers, null, 2));
}

async function erase() {
  for (const token of known) await ask("/me", { method: "DELETE", token });
  own.hidden = true;
  say(gettext("Erased. Copies that others downloaded before may still exist."));
}

element("export", HTMLButtonElement).addEventListener("click", () => save().catch(showError));
element("erase", HTMLButtonElement).addEventListener("click", () => {
  if (window.confirm(QUESTION)) erase().catch(showError);
});
window.addEventListener("hashchange", () => open().catch(showError));
open().catch(showError);
