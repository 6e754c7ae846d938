// Runs before the page is drawn, so that a dark page never flashes white.
document.body.dataset.theme = localStorage.getItem("theme") || "auto";
