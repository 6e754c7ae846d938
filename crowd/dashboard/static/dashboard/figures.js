// Draws each figure with a data-figure address that the server has not drawn. Without this script, tables have the
// same numbers.
"use strict";

/* global plotly */

const dark = window.matchMedia("(prefers-color-scheme: dark)");
// Below this width, in pixels, names on axes are shorter and fewer.
const NARROW = 560;
const still = { displayModeBar: false, responsive: true, scrollZoom: false, doubleClick: "reset" };

async function draw(figure) {
  const plot = figure.querySelector(".plot");
  const address = new URL(figure.dataset.figure, window.location.href);
  address.searchParams.set("theme", dark.matches ? "dark" : "light");
  try {
    const answer = await fetch(address);
    if (!answer.ok) throw new Error(`${answer.status} ${answer.statusText}`);
    const [{ data, layout }, library] = await Promise.all([answer.json(), plotly()]);
    plot.querySelector(".waiting")?.remove();
    await library.react(plot, data, fitted(layout, plot.clientWidth), still);
    figure.dataset.drawn = address.searchParams.get("theme");
    if (!figure.dataset.wired) {
      wire(figure, plot);
      figure.dispatchEvent(new CustomEvent("frontrunner:drawn", { bubbles: true }));
    }
  } catch (error) {
    plot.textContent = "";
    const note = document.createElement("p");
    note.className = "waiting";
    note.textContent = `This chart could not be drawn (${error.message}). The table holds the same numbers.`;
    plot.append(note);
    figure.dataset.drawn = "failed";
  }
}

// On narrow pages, applies the changes in meta.narrow, which are keyed by path ("xaxis.ticktext").
function fitted(layout, width) {
  const changes = width < NARROW ? (layout.meta?.narrow ?? {}) : {};
  for (const [path, value] of Object.entries(changes)) {
    const names = path.split(".");
    const last = names.pop();
    names.reduce((part, name) => (part[name] ??= {}), layout)[last] = value;
  }
  return layout;
}

// A mark with a page (a device, a run) has the address as the last item of customdata.
function wire(figure, plot) {
  figure.dataset.wired = "yes";
  let pointer = "mouse";
  let taps = 0;
  const named = { target: null, tap: 0 };
  const press = ({ pointerType }) => {
    pointer = pointerType;
    taps += 1;
  };
  plot.addEventListener("pointerdown", press, { capture: true });
  plot.on("plotly_click", ({ points: [point] }) => {
    const [words, target] = markDetails(point);
    if (!target) return;
    // On touch screens, the first tap names a mark, and a second tap on it opens its page. Plotly may report a
    // tap twice.
    if (pointer === "mouse" || (named.target === target && named.tap < taps)) window.location.assign(target);
    else if (named.target !== target) {
      Object.assign(named, { target, tap: taps });
      name(figure, words, target);
    }
  });
}

// The lines of a mark's label, and the address of its page.
function markDetails(point) {
  const [words, target] = [point.customdata].flat();
  const page = typeof target === "string" && /^\/[^/]/.test(target) ? target : null;
  const lines = new DOMParser().parseFromString(String(words).replaceAll("<br>", "\n"), "text/html");
  return [lines.body.textContent.split("\n"), page];
}

// Names the tapped mark below the plot, with a link to its page.
function name(figure, [title, ...lines], target) {
  const note = figure.querySelector(".named") ?? document.createElement("p");
  note.className = "named";
  note.setAttribute("role", "status");
  const link = document.createElement("a");
  link.href = target;
  link.textContent = title;
  note.replaceChildren(link, ...lines.flatMap((line) => [document.createElement("br"), line]));
  figure.querySelector(".plot").after(note);
}

function figures() {
  return [...document.querySelectorAll("figure[data-figure]:not([data-drawn=here])")];
}

// A figure inside a closed part of the page is not drawn until that part opens.
function begin() {
  for (const figure of figures().filter((each) => !each.dataset.begun && each.checkVisibility())) {
    figure.dataset.begun = "yes";
    draw(figure);
  }
}

function drawAgain() {
  figures()
    .filter(({ dataset }) => dataset.begun)
    .forEach(draw);
}

begin();
document.addEventListener("toggle", begin, { capture: true });
// Where a window becomes wider, closed parts may open by a rule of the style sheet.
window.addEventListener("resize", begin);
dark.addEventListener("change", drawAgain);
document.addEventListener("frontrunner:changed", () => {
  drawAgain();
  begin();
});
// When filters change, htmx replaces figures: free the old ones, draw the new ones.
document.addEventListener("htmx:beforeSwap", ({ target }) => {
  target.querySelectorAll(".js-plotly-plot").forEach((plot) => window.Plotly.purge(plot));
});
document.addEventListener("htmx:afterSettle", begin);
