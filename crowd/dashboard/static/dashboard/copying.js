// Copies a citation to the clipboard. Without this script, its text can be selected.
"use strict";

async function copy(text) {
  if (navigator.clipboard) return navigator.clipboard.writeText(text);
  // Pages without HTTPS do not have the clipboard API.
  const field = document.createElement("textarea");
  field.value = text;
  document.body.append(field);
  field.select();
  const copied = document.execCommand("copy");
  field.remove();
  if (!copied) throw new Error("the browser does not allow it");
}

function reveal() {
  for (const button of document.querySelectorAll("[data-copy]")) button.closest("[hidden]")?.removeAttribute("hidden");
}

document.addEventListener("click", async ({ target }) => {
  const button = target.closest?.("[data-copy]");
  if (!button) return;
  const section = button.closest("section");
  const source = (button.closest("details") ?? section).querySelector("[data-text]");
  const message = section.querySelector("[data-told]");
  try {
    await copy(source.value ?? source.textContent.trim());
    message.textContent = "Copied.";
  } catch (error) {
    message.textContent = `Not copied (${error.message}): select the text instead.`;
  }
});

reveal();
document.addEventListener("htmx:afterSettle", reveal);
