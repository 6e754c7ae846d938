// Draws every figure that has a data-figure address; the tables beside it hold the same numbers without this script.
"use strict";

const dark = window.matchMedia("(prefers-color-scheme: dark)");
const still = { displayModeBar: false, responsive: true, scrollZoom: false, doubleClick: "reset" };

async function draw(figure) {
  const plot = figure.querySelector(".plot");
  const address = new URL(figure.dataset.figure, window.location.href);
  address.searchParams.set("theme", dark.matches ? "dark" : "light");
  try {
    const answer = await fetch(address);
    if (!answer.ok) throw new Error(`${answer.status} ${answer.statusText}`);
    const { data, layout } = await answer.json();
    plot.querySelector(".waiting")?.remove();
    await window.Plotly.react(plot, data, layout, still);
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

// A mark that stands for a page (a device, a run) carries its address as the last item of customdata.
function wire(figure, plot) {
  figure.dataset.wired = "yes";
  plot.on("plotly_click", ({ points }) => {
    const target = [points[0].customdata].flat().at(-1);
    if (typeof target === "string" && /^\/[^/]/.test(target)) window.location.assign(target);
  });
}

function figures() {
  return [...document.querySelectorAll("figure[data-figure]")];
}

function begin() {
  for (const figure of figures().filter(({ dataset }) => !dataset.drawn && !dataset.begun)) {
    figure.dataset.begun = "yes";
    draw(figure);
  }
}

begin();
dark.addEventListener("change", () => figures().forEach(draw));
document.addEventListener("frontrunner:changed", () => figures().forEach(draw));
// A change of filters replaces figures: the old ones let go of the window, the new ones are drawn.
document.addEventListener("htmx:beforeSwap", ({ target }) => {
  target.querySelectorAll(".js-plotly-plot").forEach((plot) => window.Plotly.purge(plot));
});
document.addEventListener("htmx:afterSettle", begin);
