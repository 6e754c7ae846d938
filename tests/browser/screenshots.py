"""Pictures of a running server's pages: python -m tests.browser.screenshots URL FOLDER [PATH ...].

A PATH with a fragment, /explorations/1/#plane, is a picture of the figures in the section of that heading;
of other pages the upper part is taken.
"""

import sys
from pathlib import Path

from PIL import Image

from tests.browser.chromium import NoBrowserError, launched
from tests.browser.visitor import Visitor

PHONE, DESK = 390, 1280
# Pixels of a page that a reader of a picture looks at.
TALLEST = 1760


def name_of(path: str, width: int, scheme: str) -> str:
    """The picture's file name: home-desk-light.png, devices-phone-dark.png."""
    page = path.split("?")[0].replace("#", "").strip("/").replace("/", "-") or "home"
    return f"{page}-{'phone' if width == PHONE else 'desk'}-{scheme}.png"


def shrink(target: Path) -> None:
    """Keep the 256 colours that most pixels have, and round the others, which are at the edges of letters.

    A palette made of all colours alike would merge those that mean something.
    """
    with Image.open(target) as picture:
        pixels = picture.convert("RGB")
    counted = sorted(pixels.getcolors(pixels.width * pixels.height), reverse=True)
    palette = Image.new("P", (1, 1))
    palette.putpalette([channel for _, colour in counted[:256] for channel in colour])
    pixels.quantize(palette=palette, dither=Image.Dither.NONE).save(target, optimize=True)


def main(server: str, folder: Path, paths: list[str]) -> int:
    """Every page at both widths in both themes; 1 where a page complained or there is no browser."""
    folder.mkdir(parents=True, exist_ok=True)
    complaints: list[str] = []
    try:
        with launched() as browser:
            for width in (PHONE, DESK):
                for scheme in ("light", "dark"):
                    visitor = Visitor(browser, server.rstrip("/"), width, scheme)
                    for path in paths:
                        target = folder / name_of(path, width, scheme)
                        page = visitor.open(path)
                        _, _, heading = path.partition("#")
                        if heading:
                            page.locator(f"section:has(#{heading}) .plot").first.screenshot(path=target)
                        else:
                            height = min(page.evaluate("document.documentElement.scrollHeight"), TALLEST)
                            page.set_viewport_size({"width": width, "height": height})
                            page.screenshot(path=target)
                        shrink(target)
                        print(target)
                    complaints += visitor.complaints
                    visitor.context.close()
    except NoBrowserError as error:
        complaints.append(str(error))
    sys.stderr.writelines(f"{complaint}\n" for complaint in complaints)
    return 1 if complaints else 0


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    sys.exit(main(sys.argv[1], Path(sys.argv[2]), sys.argv[3:] or ["/"]))
