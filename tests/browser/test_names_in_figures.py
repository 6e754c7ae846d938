"""The names that figures write beside their points, on the front that ships."""

from typing import Any

from tests.browser.visitor import Visitor
from tests.builders.known_front import NAME
from tests.predictions.conftest import document, front, join, measured, published

__all__ = ["document", "front", "join", "measured", "published"]

NAMES = ["accurate", "best", "default", "fast3", "knee"]
# The names with their boxes: left, top, right, bottom.
WRITTEN = """() => [...document.querySelectorAll("figure .annotation-text")].map((text) => {
  const { left, top, right, bottom } = text.getBoundingClientRect();
  return [text.textContent, left, top, right, bottom];
})"""

# Whether plotly has followed the window, which it does a moment later.
FOLLOWED = """() => {
  const plot = document.querySelector("figure .plot");
  return Math.abs(plot.querySelector(".main-svg").clientWidth - plot.clientWidth) < 1;
}"""


def faults(written: list[Any], width: int) -> list[Any]:
    """Names that are missing, cut, or written over another one."""
    names = sorted(name for name, *_ in written if " " not in name)
    found: list[Any] = [] if names == NAMES else [names]
    for number, (name, left, top, right, bottom) in enumerate(written):
        if not 0 <= left < right <= width:
            found.append((name, left, right))
        for other, its_left, its_top, its_right, its_bottom in written[:number]:
            across = min(right, its_right) - max(left, its_left)
            up = min(bottom, its_bottom) - max(top, its_top)
            if min(across, up) > 0:
                found.append((name, other))
    return found


def test_names_overlap_at_no_width(chromium: Any, live_server: Any, measured: Any, settings: Any) -> None:
    settings.FRONTRUNNER_QUORUM = 1
    measured()
    visitor = Visitor(chromium, live_server.url, width=360)
    for address in (f"/fronts/{NAME}/", "/recommend/"):
        page = visitor.open(address)
        for width in (360, 390, 768, 1400):
            page.set_viewport_size({"width": width, "height": 844})
            page.wait_for_function(FOLLOWED)
            assert faults(page.evaluate(WRITTEN), width) == [], (address, width)
    assert visitor.complaints == []
    page.wait_for_load_state("networkidle")
    visitor.context.close()
