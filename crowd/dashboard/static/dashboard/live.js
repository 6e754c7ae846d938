// Updates the changing parts of a page, and has figures redrawn when they change.
"use strict";

const EVERY = 3000;
const LONGEST = 60000;

let pause = EVERY;

async function refresh() {
  try {
    const { live } = document.querySelector("[data-live]").dataset;
    // While nothing changed, the server answers 304, and the browser returns its cached copy.
    const answer = await fetch(live + window.location.search, { cache: "no-cache" });
    if (!answer.ok) throw new Error(`${answer.status}`);
    replace(await answer.text());
    pause = EVERY;
  } catch {
    pause = Math.min(2 * pause, LONGEST);
  }
  // A finished exploration has no data-live.
  if (document.querySelector("[data-live]")) window.setTimeout(ready, pause);
}

function replace(text) {
  const fresh = document.createElement("template");
  fresh.innerHTML = text;
  const [now, before] = [fresh.content.querySelector("[data-version]"), document.querySelector("[data-version]")];
  if (now.dataset.version === before.dataset.version) return;
  for (const part of [...fresh.content.children]) {
    const old = document.getElementById(part.id);
    // Figures stay, unless other figures are to be drawn.
    if (part.dataset.kind === undefined || part.dataset.kind !== old.dataset.kind) keepingPlace(old, part);
  }
  if (now.dataset.results !== before.dataset.results) document.dispatchEvent(new Event("frontrunner:changed"));
}

// Keeps the scroll positions of tables, and the focused link.
function keepingPlace(old, part) {
  const places = (element) => [...element.querySelectorAll("a, [tabindex]")];
  const before = places(old);
  const focused = before.indexOf(document.activeElement);
  const scrolled = before.map((place) => place.scrollLeft);
  old.replaceWith(part);
  places(part).forEach((place, number) => (place.scrollLeft = scrolled[number] ?? 0));
  if (focused >= 0) places(part)[focused]?.focus({ preventScroll: true });
}

function ready() {
  if (document.hidden) document.addEventListener("visibilitychange", refresh, { once: true });
  else refresh();
}

refresh();
