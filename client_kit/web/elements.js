/**
 * The element ID of the page.
 * @template {HTMLElement} T
 * @param {string} id
 * @param {new () => T} kind
 * @returns {T}
 */
export function element(id, kind) {
  const found = document.getElementById(id);
  if (!(found instanceof kind)) throw new Error(`the page has no ${kind.name} ${id}`);
  return found;
}

const title = document.title;

/**
 * Show TEXT before the page's title, where a tab in the background is read; without TEXT, the title alone.
 * @param {string} text
 */
export function showTitle(text) {
  document.title = text ? `${text} · ${title}` : title;
}
