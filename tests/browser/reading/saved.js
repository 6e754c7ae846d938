// What is wrong with the text of a figure that is saved for a medium, as a list of sentences: text outside of the
// picture, fonts that are not those of the medium, and text of the frame, legend and axes that overlaps.
async ([address, smallest, largest]) => {
  const { data, layout, saved } = await (await fetch(address)).json();
  const { width, height } = layout;
  const body = await (await plotly()).toImage({ data, layout }, { format: "svg", width, height });
  const place = document.createElement("div");
  place.style.cssText = `position: absolute; left: 0; top: 0; width: ${saved.width}px; height: ${saved.height}px`;
  // The function of saving.js, which is under test.
  place.innerHTML = framed(body, saved);
  const drawing = place.firstElementChild;
  drawing.setAttribute("width", saved.width);
  drawing.setAttribute("height", saved.height);
  document.body.append(place);

  const found = [];
  const outer = drawing.getBoundingClientRect();
  const written = [...drawing.querySelectorAll("text")].filter((text) => text.textContent.trim() && text.getBoundingClientRect().width);
  const words = (text) => text.textContent.trim().slice(0, 60);
  const part = (text) => ["frame", "legend", "g-xtitle", "g-ytitle", "xtick", "ytick"].find((name) => text.closest(`[class^="${name}"]`));
  for (const text of written) {
    const box = text.getBoundingClientRect();
    if (box.left < outer.left - 1 || box.right > outer.right + 1 || box.top < outer.top - 1 || box.bottom > outer.bottom + 1) {
      found.push(`outside: ${words(text)} (${[box.left, box.top, box.right, box.bottom].map(Math.round)} of ${saved.width} x ${saved.height})`);
    }
    const points = (Number.parseFloat(getComputedStyle(text).fontSize) * saved.millimetres[0] * 72) / 25.4 / saved.width;
    if (points < smallest || points > largest) found.push(`${points.toFixed(1)} pt: ${words(text)}`);
  }
  // Ticks that are at an angle have boxes larger than their text.
  const straight = (text) => !/rotate\((?!0|-?90|180)/.test(text.getAttribute("transform") ?? "");
  const measured = written.filter((text) => part(text) && straight(text)).map((text) => [text, part(text), text.getBoundingClientRect()]);
  measured.forEach(([one, kind, box], i) => {
    for (const [other, its, next] of measured.slice(i + 1)) {
      const across = Math.min(box.right, next.right) - Math.max(box.left, next.left);
      const down = Math.min(box.bottom, next.bottom) - Math.max(box.top, next.top);
      // Lines of text that follow each other closely share a pixel or two of their boxes.
      if (across > 1 && down > 3) found.push(`${kind} "${words(one)}" on ${its} "${words(other)}" (${across.toFixed()} x ${down.toFixed()})`);
    }
  });
  const parts = [...new Set(measured.map(([, kind]) => kind))];
  place.remove();
  return { found, parts, legend: layout.showlegend !== false && drawing.querySelectorAll(".legend .traces").length, texts: written.length };
}
