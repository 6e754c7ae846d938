// Saves a figure as SVG, PNG or PDF for a column of a paper or a slide. The server gives the size and the lines of text
// around the figure; plotly draws it.
"use strict";

/* global plotly */

const SVG = "http://www.w3.org/2000/svg";

async function save(figure, kind, medium) {
  const address = new URL(figure.dataset.figure, window.location.href);
  address.searchParams.set("save", medium);
  const answer = await fetch(address);
  if (!answer.ok) throw new Error(`${answer.status} ${answer.statusText}`);
  const [{ data, layout, saved }, library] = await Promise.all([answer.json(), plotly()]);
  const { width, height } = layout;
  const body = await library.toImage({ data, layout }, { format: "svg", width, height });
  const drawing = framed(body, saved);
  if (kind === "pdf") {
    print(drawing, saved);
    return;
  }
  const file = kind === "svg" ? new Blob([drawing], { type: "image/svg+xml" }) : await painted(drawing, saved);
  const link = document.createElement("a");
  link.href = URL.createObjectURL(file);
  link.download = `${saved.name}.${kind}`;
  link.click();
  // The browser reads the URL a moment later.
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

// Plotly's drawing with the lines of text above and below it.
function framed(address, { width, height, top, lines, font, background, millimetres, title, description }) {
  const markup = decodeURIComponent(address.slice(address.indexOf(",") + 1));
  const drawing = new DOMParser().parseFromString(markup, "image/svg+xml").documentElement;
  const add = (parent, name, attributes, text = "") => {
    const element = drawing.ownerDocument.createElementNS(SVG, name);
    Object.entries(attributes).forEach(([key, value]) => element.setAttribute(key, value));
    element.textContent = text;
    parent.append(element);
    return element;
  };
  const body = [...drawing.childNodes];
  add(drawing, "title", {}, title);
  add(drawing, "desc", {}, description);
  add(drawing, "rect", { width, height, fill: background });
  add(drawing, "g", { transform: `translate(0,${top})`, class: "body" }).append(...body);
  const frame = add(drawing, "g", { class: "frame", "font-family": font });
  for (const { text, x, y, size, weight, colour } of lines) {
    add(frame, "text", { x, y, "font-size": size, "font-weight": weight, fill: colour }, text);
  }
  const size = { width: `${millimetres[0]}mm`, height: `${millimetres[1]}mm`, viewBox: `0 0 ${width} ${height}` };
  Object.entries({ ...size, role: "img" }).forEach(([key, value]) => drawing.setAttribute(key, value));
  return new XMLSerializer().serializeToString(drawing);
}

// Lets the browser print the drawing on a page of its size: "Save as PDF" keeps lines and fonts.
function print(drawing, { name, millimetres: [width, height] }) {
  const frame = document.createElement("iframe");
  frame.title = name;
  frame.className = "printed";
  document.body.append(frame);
  const { contentDocument, contentWindow } = frame;
  const sheet = new contentWindow.CSSStyleSheet();
  sheet.replaceSync(`@page { size: ${width}mm ${height}mm; margin: 0 } body { margin: 0 } svg { display: block }`);
  contentDocument.adoptedStyleSheets = [sheet];
  const picture = new DOMParser().parseFromString(drawing, "image/svg+xml").documentElement;
  contentDocument.body.append(contentDocument.importNode(picture, true));
  // Browsers propose the page's title as the name of the file.
  const title = document.title;
  document.title = name;
  contentWindow.addEventListener("afterprint", () => {
    document.title = title;
    frame.remove();
  });
  contentWindow.print();
}

// Plotly's own PNG needs a blob: URL, which the content security policy forbids for images.
async function painted(drawing, { pixels: [width, height], dpi }) {
  const image = new Image();
  image.src = `data:image/svg+xml,${encodeURIComponent(drawing)}`;
  await image.decode();
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = height;
  canvas.getContext("2d").drawImage(image, 0, 0, width, height);
  const picture = await new Promise((done) => canvas.toBlob(done, "image/png"));
  return withResolution(new Uint8Array(await picture.arrayBuffer()), dpi);
}

// Adds a pHYs chunk after the header (PNG specification, 11.3.5.3): LaTeX and Word take the size from it.
function withResolution(picture, dpi) {
  const HEADER = 33;
  const chunk = new DataView(new ArrayBuffer(21));
  chunk.setUint32(0, 9);
  [..."pHYs"].forEach((letter, i) => chunk.setUint8(4 + i, letter.charCodeAt(0)));
  const perMetre = Math.round(dpi / 0.0254);
  chunk.setUint32(8, perMetre);
  chunk.setUint32(12, perMetre);
  chunk.setUint8(16, 1);
  chunk.setUint32(17, crc(new Uint8Array(chunk.buffer, 4, 13)));
  return new Blob([picture.slice(0, HEADER), chunk.buffer, picture.slice(HEADER)], { type: "image/png" });
}

// The checksum of a PNG chunk (annex D of the specification).
function crc(bytes) {
  let sum = ~0;
  for (const byte of bytes) {
    sum ^= byte;
    for (let bit = 0; bit < 8; bit++) sum = sum & 1 ? (sum >>> 1) ^ 0xedb88320 : sum >>> 1;
  }
  return ~sum >>> 0;
}

// The buttons appear when the figure is drawn.
function offer(figure) {
  figure.querySelectorAll("[data-save]").forEach((button) => button.closest("[hidden]")?.removeAttribute("hidden"));
}

function offerDrawn() {
  document.querySelectorAll("[data-drawn=here]").forEach(offer);
}

offerDrawn();
document.addEventListener("htmx:afterSettle", offerDrawn);
document.addEventListener("frontrunner:drawn", ({ target }) => offer(target));

document.addEventListener("click", async ({ target }) => {
  const button = target.closest?.("[data-save]");
  if (!button) return;
  const figure = button.closest("figure");
  const message = figure.querySelector("[data-told]");
  message.textContent = "";
  button.disabled = true;
  try {
    await save(figure, button.dataset.save, button.dataset.medium);
  } catch (error) {
    message.textContent = `The picture could not be saved (${error.message}).`;
  } finally {
    button.disabled = false;
  }
});
