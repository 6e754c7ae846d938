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
      offer(figure);
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

// Saves a figure as it is seen, with what it shows, n and its address: SVG as plotly draws it, PNG at twice the size.
async function save(figure, kind) {
  const plot = figure.querySelector(".plot");
  const shown = getComputedStyle(figure);
  const title = figure.closest("section")?.querySelector("h2, h3")?.textContent.trim() ?? document.title;
  const n = figure.querySelector("figcaption strong")?.textContent.trim() ?? "";
  const { margin } = plot.layout;
  const layout = {
    ...plot.layout,
    paper_bgcolor: shown.backgroundColor,
    // Of the element: a window that changed its size makes plotly forget the layout's own.
    height: plot.clientHeight + 60,
    margin: { ...margin, t: margin.t + 60 },
    title: { text: plain(title), subtitle: { text: plain(`${n} ${window.location.href}`) }, x: 0, xref: "paper", y: 1, yref: "container", pad: { t: 14 }, yanchor: "top" },
  };
  const size = { width: plot.clientWidth, height: layout.height };
  const drawing = await window.Plotly.toImage({ data: plot.data, layout }, { format: "svg", ...size });
  const image = kind === "svg" ? drawing : await painted(drawing, size);
  const link = document.createElement("a");
  link.href = image;
  link.download = `${figure.dataset.name}.${kind}`;
  link.click();
}

// Plotly's own PNG goes through a blob: address, which the policy does not allow to images.
async function painted(drawing, { width, height }) {
  const image = new Image();
  image.src = drawing;
  await image.decode();
  const canvas = document.createElement("canvas");
  canvas.width = 2 * width;
  canvas.height = 2 * height;
  canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
  return canvas.toDataURL("image/png");
}

// Plotly reads a small HTML in every text.
function plain(text) {
  return text.replace(/\s+/g, " ").replaceAll("&", "&amp;").replaceAll("<", "&lt;");
}

function figures() {
  return [...document.querySelectorAll("figure[data-figure]")];
}

// Buttons that only work where there is something drawn.
function offer(figure) {
  for (const button of figure.querySelectorAll("[data-save]")) {
    button.closest("[hidden]")?.removeAttribute("hidden");
    button.onclick = () => save(figure, button.dataset.save);
  }
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
