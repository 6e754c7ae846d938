// What a screen reader or a keyboard would stumble over on the present page, as a list of sentences.
() => {
  const found = [];
  const every = (selector, sound, what) => {
    for (const element of document.querySelectorAll(selector)) {
      if (!sound(element)) found.push(`${what}: ${element.outerHTML.slice(0, 90)}`);
    }
  };

  const levels = [...document.querySelectorAll("h1, h2, h3, h4")].map((heading) => Number(heading.tagName[1]));
  if (levels.filter((level) => level === 1).length !== 1) found.push("not exactly one h1");
  levels.forEach((level, i) => {
    if (i && level > levels[i - 1] + 1) found.push(`h${level} after h${levels[i - 1]}`);
  });
  if (!document.documentElement.lang) found.push("the page has no language");
  if (!document.title) found.push("the page has no title");
  if (!document.querySelector("meta[name=description]")?.content) found.push("the page has no description");

  // Text is there before any script has run. Modules wait for it by themselves.
  every("script[src]", (e) => e.defer || e.async || e.type === "module", "a script that holds up the text");
  every("a, button", (e) => e.getAttribute("aria-label") || e.textContent.trim(), "a control without a name");
  every("input:not([type=hidden]), select, textarea", (e) => e.labels.length || e.getAttribute("aria-label"), "a field without a label");
  every("[role=img], [role=region]", (e) => e.getAttribute("aria-label"), "a part without a name");
  every(".scroll", (e) => e.tabIndex === 0, "a scrolling part that no keyboard reaches");
  every("th", (e) => e.scope, "a header cell without a scope");
  every("table", (e) => e.querySelector("thead th"), "a table without headers");
  every("[aria-labelledby]", (e) => document.getElementById(e.getAttribute("aria-labelledby")), "a label that is missing");

  const ids = [...document.querySelectorAll("[id]:not(svg *)")].map((element) => element.id);
  ids.filter((id, i) => ids.indexOf(id) !== i).forEach((id) => found.push(`two elements have the id ${id}`));
  return found;
}
