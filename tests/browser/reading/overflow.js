// What makes the present page wider than its screen: the elements that stick out, outermost first.
() => {
  const width = document.documentElement.clientWidth;
  if (document.documentElement.scrollWidth <= width) return [];
  const sticksOut = (element) => {
    const box = element.getBoundingClientRect();
    return box.width && box.right > width + 0.5 && !element.closest(".scroll > *, .commands > *");
  };
  return [...document.body.querySelectorAll("*")].filter(sticksOut).slice(0, 5).map((element) => element.outerHTML.slice(0, 120));
}
