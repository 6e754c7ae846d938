"""What people save and cite: figures in which nothing is cut or overlaps, and how a page is cited."""

import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from crowd.dashboard.drawings import DRAWINGS
from tests.browser.reading.site import API_PAGES, EMBEDDED, Site, page_names
from tests.browser.visitor import Visitor
from tests.waiting import until

pytestmark = pytest.mark.django_db

MEASURE = (Path(__file__).parent / "saved.js").read_text()
# Fonts in points; those of a slide are smaller where it shows many rows.
FONTS = {"column": (7.0, 9.05), "slide": (6.0, 30.0)}
# Pages that show no data of the crowd, of a front or of an exploration, or that belong to one person.
NOT_CITED = {"key", "about", "compare-nothing", "measure", "mine", "search", *API_PAGES}
COUNT_COPIES = """() => {
  window.copies = 0;
  const write = navigator.clipboard.writeText.bind(navigator.clipboard);
  navigator.clipboard.writeText = (text) => { window.copies += 1; return write(text); };
}"""
# What a frame that is printed holds, and its style.
NOTE_PRINTED = """window.print = () => {
  const rules = document.adoptedStyleSheets.flatMap((sheet) => [...sheet.cssRules]);
  top.printed = [document.body.innerHTML, rules.map((rule) => rule.cssText).join("")];
};"""
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def visitor(chromium: Any, site: Site) -> Iterator[Visitor]:
    """A tab in the dark theme: saved figures are white all the same."""
    one = Visitor(chromium, site.url, scheme="dark")
    one.open("/devices/")
    yield one
    one.context.close()


@pytest.mark.parametrize("name", [drawing.name for drawing in DRAWINGS])
def test_the_text_of_a_saved_figure_is_whole_and_overlaps_nothing(
    site: Site, visitor: Visitor, name: str
) -> None:
    visitor.complaints.clear()
    path, _, query = site.pages[f"{name}{EMBEDDED}"].removeprefix("/embed/").partition("?")
    for medium, fonts in FONTS.items():
        address = f"/figures/{path.rstrip('/')}.json?{query}&save={medium}"

        figure = visitor.page.evaluate(MEASURE, [address, *fonts])

        assert figure["found"] == [], medium
        assert "frame" in figure["parts"]
        assert not figure["legend"] or "legend" in figure["parts"]
        assert figure["texts"] > 3
    assert visitor.complaints == []


@pytest.fixture
def taken(visitor: Visitor, tmp_path: Path) -> Callable[[str, str], bytes]:
    """What the button for a format and a medium downloads to, on the page of devices."""

    def take(kind: str, medium: str) -> bytes:
        visitor.complaints.clear()
        details = visitor.page.locator("figure[data-name=frontrunner-speedups] details.take")
        if details.get_attribute("open") is None:
            details.locator("summary").click()
        with visitor.page.expect_download() as download:
            details.get_by_role("button", name=f"{kind.upper()} for a {medium}").click()
        target = tmp_path / download.value.suggested_filename
        download.value.save_as(target)
        where = {"paper": "column"}.get(medium, medium)
        assert target.name == f"frontrunner-speedups-{where}.{kind}"
        assert visitor.complaints == []
        return target.read_bytes()

    return take


def test_an_svg_stands_for_itself_and_says_what_it_shows(taken: Callable[[str, str], bytes]) -> None:
    drawing = ElementTree.fromstring(taken("svg", "paper"))

    words = " ".join("".join(drawing.itertext()).split())
    assert drawing.attrib["width"] == "85mm"
    assert drawing.attrib["role"] == "img"
    assert "faster with best" in drawing.findtext(f"{SVG}title", "")
    assert "Speedup by device" in drawing.findtext(f"{SVG}desc", "")
    assert "Pixel 8" in words
    assert "of the open data" in words
    assert not re.search(r"url\((?!['\"]?#)|@font-face|href=\"http", ElementTree.tostring(drawing).decode())


@pytest.mark.parametrize(("medium", "width", "dpi"), [("paper", 1004, 300), ("slide", 1920, 144)])
def test_a_png_has_the_pixels_and_the_resolution_of_its_medium(
    taken: Callable[[str, str], bytes], medium: str, width: int, dpi: int
) -> None:
    picture = taken("png", medium)

    assert picture.startswith(b"\x89PNG")
    assert int.from_bytes(picture[16:20], "big") == width
    assert medium == "paper" or int.from_bytes(picture[20:24], "big") == 1080
    at = picture.index(b"pHYs") + 4
    assert round(int.from_bytes(picture[at : at + 4], "big") * 0.0254) == dpi


@pytest.mark.parametrize(("medium", "width"), [("paper", 85.0), ("slide", 338.67)])
def test_a_printed_figure_is_a_page_of_its_size_with_lines_and_fonts(
    chromium: Any, site: Site, medium: str, width: float
) -> None:
    one = Visitor(chromium, site.url)
    one.page.add_init_script(NOTE_PRINTED)
    one.open("/devices/")
    details = one.page.locator("figure[data-name=frontrunner-speedups] details.take")
    details.locator("summary").click()
    details.get_by_role("button", name=f"Print for a {medium}, or save as PDF").click()
    one.page.locator("iframe.printed").wait_for(state="attached")
    body, style = until(lambda: one.page.evaluate("window.printed"))
    assert one.complaints == []
    sheet = one.context.new_page()
    sheet.set_content(f"<style>{style}</style>{body}")

    content = sheet.pdf(prefer_css_page_size=True)

    one.context.close()
    boxes = re.findall(rb"/MediaBox \[0 0 ([0-9.]+) [0-9.]+\]", content)
    assert [float(box) * 25.4 / 72 for box in boxes] == [pytest.approx(width, abs=0.5)]
    assert b"/Type /Font" in content
    # Chromium paints the hatching of unconfirmed bars as pictures, and nothing else.
    assert content.count(b"/Subtype /Image") <= 2 * body.count("<pattern")


def test_every_page_that_shows_data_says_how_to_cite_it(site: Site, visitor: Visitor) -> None:
    for name in page_names():
        page = visitor.page.request.get(f"{site.url}{site.pages[name]}").text()
        assert page.count('id="cite"') == (name not in NOT_CITED), name


def test_a_citation_is_copied_and_downloaded(chromium: Any, site: Site, tmp_path: Path) -> None:
    visitor = Visitor(chromium, site.url, permissions=["clipboard-read", "clipboard-write"])
    page = visitor.open("/devices/")
    page.locator("select[name=vendor]").select_option("Mali")
    page.wait_for_url("**/devices/?vendor=Mali")
    page.evaluate(COUNT_COPIES)
    cite = page.locator("section.cite")

    cite.get_by_role("button", name="Copy the text").click()
    cite.get_by_text("Copied.").wait_for()
    text = page.evaluate("navigator.clipboard.readText()")
    assert page.evaluate("window.copies") == 1
    cite.get_by_text("BibTeX", exact=True).click()
    cite.get_by_role("button", name="Copy the BibTeX").click()
    copied = partial(page.evaluate, "navigator.clipboard.readText()")
    until(lambda: copied().startswith("@misc"), seen=copied)
    bibtex = copied()
    with visitor.page.expect_download() as download:
        cite.get_by_role("link", name="Download .bib").click()
    download.value.save_as(tmp_path / "file.bib")

    assert f"{site.url}/devices/?vendor=Mali" in text
    assert f"url = {{{site.url}/devices/?vendor=Mali}}" in bibtex
    assert (tmp_path / "file.bib").read_text() == bibtex
    assert re.fullmatch(r"frontrunner-\d{4}-devices-[0-9a-f]{4}\.bib", download.value.suggested_filename)
    assert visitor.complaints == []
    visitor.context.close()
