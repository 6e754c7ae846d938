// Shows the value of a slider of errors (metres) in centimetres while it moves.
"use strict";

document.addEventListener("input", ({ target }) => {
  if (!target.matches("input[type=range]")) return;
  const words = `${(100 * target.value).toFixed(2)}\u202fcm`;
  target.parentElement.querySelector("output").value = words;
  target.setAttribute("aria-valuetext", words);
});
