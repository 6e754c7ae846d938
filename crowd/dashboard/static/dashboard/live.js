// Keeps the part of a page that names its own address up to date, and has the figures drawn again when it changed.
"use strict";

const EVERY = 3000;
const AT_MOST = 60000;

const region = document.querySelector("[data-live]");
let shown = null;
let pause = EVERY;

async function refresh() {
  try {
    // The server answers 304 while nothing changed, and the browser hands on what it holds.
    const answer = await fetch(region.dataset.live + window.location.search, { cache: "no-cache" });
    if (!answer.ok) throw new Error(`${answer.status}`);
    const text = await answer.text();
    if (shown !== null && text !== shown) replace(text);
    shown = text;
    pause = EVERY;
  } catch {
    pause = Math.min(2 * pause, AT_MOST);
  }
  schedule();
}

// Who reads a table stays where they are: scrolled as far, and on the same link.
function replace(text) {
  const places = () => [...region.querySelectorAll("a, [tabindex]")];
  const focused = places().indexOf(document.activeElement);
  const scrolled = places().map((place) => place.scrollLeft);
  region.innerHTML = text;
  places().forEach((place, number) => (place.scrollLeft = scrolled[number] ?? 0));
  if (focused >= 0) places()[focused]?.focus({ preventScroll: true });
  document.dispatchEvent(new Event("frontrunner:changed"));
}

function schedule() {
  if (!region.querySelector("[data-still]")) window.setTimeout(ready, pause);
}

function ready() {
  if (document.hidden) document.addEventListener("visibilitychange", refresh, { once: true });
  else refresh();
}

refresh();
