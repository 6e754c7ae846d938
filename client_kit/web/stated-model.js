/** The model that a participant states, where the browser does not tell it. */

import * as database from "./database.js";
import { element } from "./elements.js";
import { askJson } from "./server.js";

const modelInput = element("model", HTMLInputElement);

/** @type {Map<string, {manufacturer: string, model: string}>} */
const offered = new Map();

/** Offer names as they are typed, and keep the one that was chosen. Returns whether that changed. */
async function chosen() {
  const stated = offered.get(modelInput.value);
  if (stated || !modelInput.value) {
    if (stated) await database.write("settings", "stated", stated);
    else await database.remove("settings", "stated");
    return true;
  }
  const found = await askJson(`/models?${new URLSearchParams({ search: modelInput.value })}`).catch(() => null);
  if (!found) return false;
  const options = found.results.map((/** @type {{name: string, manufacturer: string, model: string}} */ row) => {
    offered.set(row.name, { manufacturer: row.manufacturer, model: row.model });
    const option = document.createElement("option");
    option.value = row.name;
    return option;
  });
  element("models", HTMLDataListElement).replaceChildren(...options);
  return false;
}

/**
 * Call CHANGED whenever a model was stated or withdrawn.
 * @param {() => Promise<void>} changed
 */
export function onStated(changed) {
  modelInput.addEventListener("input", async () => {
    if (await chosen()) await changed();
  });
}
