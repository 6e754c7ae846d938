// Suggestions below a search field: arrow keys move through them, Escape closes them.

document.addEventListener("keydown", (event) => {
  const search = event.target.closest(".search");
  if (!search) return;
  const list = search.querySelector(".suggestions");
  const stops = [search.querySelector("input[type=search]"), ...list.querySelectorAll("a")];
  const place = stops.indexOf(event.target);
  if (event.key === "Escape" && list.childElementCount) {
    list.replaceChildren();
    stops[0].focus();
    event.preventDefault();
  } else if ((event.key === "ArrowDown" || event.key === "ArrowUp") && place >= 0) {
    const next = stops[place + (event.key === "ArrowDown" ? 1 : -1)];
    if (next) next.focus();
    event.preventDefault();
  }
});
