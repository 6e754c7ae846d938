// Keeps the parts of a page that change up to date, and has the figures drawn again when they did.
"use strict";

const EVERY = 3000;
const AT_MOST = 60000;

let pause = EVERY;

async function refresh() {
  try {
    const { live } = document.querySelector("[data-live]").dataset;
    // The server answers 304 while nothing changed, and the browser hands on what it holds.
    const answer = await fetch(live + window.location.search, { cache: "no-cache" });
    if (!answer.ok) throw new Error(`${answer.status}`);
    replace(await answer.text());
    pause = EVERY;
  } catch {
    pause = Math.min(2 * pause, AT_MOST);
  }
  // What is finished no longer says where to ask.
  if (document.querySelector("[data-live]")) window.setTimeout(ready, pause);
}

function replace(text) {
  const fresh = document.createElement("template");
  fresh.innerHTML = text;
  const [now, before] = [fresh.content.querySelector("[data-version]"), document.querySelector("[data-version]")];
  if (now.dataset.version === before.dataset.version) return;
  for (const part of [...fresh.content.children]) {
    const old = document.getElementById(part.id);
    // What is drawn stays, unless there is something else to draw.
    if (part.dataset.kind === undefined || part.dataset.kind !== old.dataset.kind) keepingPlace(old, part);
  }
  if (now.dataset.results !== before.dataset.results) document.dispatchEvent(new Event("frontrunner:changed"));
}

// Who reads a table stays where they are: scrolled as far, and on the same link.
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
