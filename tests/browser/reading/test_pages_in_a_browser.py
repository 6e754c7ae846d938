"""What a visitor can do with a page: charts under the real policy, filters, downloads, the keyboard."""

import io
import json
from collections.abc import Callable, Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from crowd.dashboard.figures.palette import DARK, LIGHT
from tests.browser.reading.site import COUNTED, Site
from tests.browser.visitor import Visitor
from tests.waiting import until

# A transaction for each test: what the site was filled with stays until the last one.
pytestmark = pytest.mark.django_db

Visit = Callable[..., Visitor]
# One more is suspect and one unconfirmed: they have bars, and are in no mean.
BARS = COUNTED + 2
LEAD = "#answer .lede"
CHANGED = "figure[data-name=frontrunner-speedups]"


@pytest.fixture(scope="module")
def visitors() -> Iterator[dict[str, Visitor]]:
    """Those who came so far: they keep what the browser has cached."""
    opened: dict[str, Visitor] = {}
    yield opened
    for visitor in opened.values():
        visitor.context.close()


@pytest.fixture
def visit(chromium: Any, site: Site, visitors: dict[str, Visitor]) -> Iterator[Visit]:
    """Opens tabs on the site, and closes them at the end."""
    opened: list[Visitor] = []

    def tab(**options: Any) -> Visitor:
        visitor = visitors.get(str(options))
        if visitor is None:
            visitor = visitors[str(options)] = Visitor(chromium, site.url, **options)
        else:
            visitor.open_tab()
        opened.append(visitor)
        return visitor

    yield tab
    for visitor in opened:
        visitor.page.close()


def test_charts_are_drawn_and_say_what_they_show(visit: Visit, site: Site) -> None:
    page = visit().open(site.pages["session"])

    plots = page.locator("figure .plot")
    assert plots.count() >= 2
    for number in range(plots.count()):
        plots.nth(number).locator("svg.main-svg").first.wait_for()
        assert plots.nth(number).get_attribute("aria-label")
    # Four runs, and four stages in two bars.
    runs = page.locator("section:has(#frames) .scatterlayer .trace")
    stages = page.locator("section:has(#stages) .barlayer .point")
    until(lambda: (runs.count(), stages.count()) == (4, 8), seen=page.content)


def test_a_front_s_page_is_short_on_a_phone(visit: Visit, site: Site) -> None:
    """Four screens of it, and the rest unfolds."""
    page = visit(width=390).open(site.pages["front"].partition("?")[0])
    height = "document.documentElement.scrollHeight"

    assert page.evaluate(height) < 4 * 844
    page.get_by_text("More: parameters").click()
    page.locator("#provenance").wait_for()


def test_a_chart_folded_on_a_phone_is_drawn_when_it_is_opened(visit: Visit, site: Site) -> None:
    page = visit(width=360).open(site.pages["session"])
    figure = page.locator("section:has(#stages) figure")
    assert not figure.is_visible()
    assert figure.get_attribute("data-drawn") is None

    page.get_by_text("Chart of the stages").click()

    figure.locator(".barlayer .point").nth(7).wait_for()


def test_charts_change_their_colours_with_the_system(visit: Visit, site: Site) -> None:
    visitor = visit(scheme="light")
    page = visitor.open(site.pages["session"])
    lines = (
        "[...document.querySelectorAll('.scatterlayer .js-line')].map(line => getComputedStyle(line).stroke)"
    )
    assert rgb(LIGHT.best) in page.evaluate(lines)

    page.emulate_media(color_scheme="dark")
    page.locator("figure:not([data-drawn=dark])").first.wait_for(state="detached")

    until(lambda: rgb(DARK.best) in page.evaluate(lines), seen=lambda: page.evaluate(lines))
    assert visitor.complaints == []


def test_a_bar_leads_to_its_device_without_a_script(visit: Visit) -> None:
    visitor = visit(java_script_enabled=False)
    page = visitor.page
    page.goto(f"{visitor.server}/devices/?vendor=NVIDIA")

    page.locator(f"{CHANGED} .bars a rect").click()

    page.wait_for_url("**/devices/google-p30/")
    assert visitor.complaints == []


def test_the_home_page_shows_its_chart_first_and_loads_no_library_for_it(visit: Visit) -> None:
    visitor = visit(width=1400)
    visitor.page.set_viewport_size({"width": 1400, "height": 900})
    asked: list[str] = []
    visitor.page.on("request", lambda request: asked.append(request.url))

    page = visitor.open("/")

    picture = page.locator(f"{CHANGED} .bars").bounding_box()
    assert picture["y"] + picture["height"] / 2 < 900
    assert picture["width"] > 1100
    assert not [address for address in asked if "plotly.min" in address or "plotly-basic" in address]
    assert visitor.complaints == []


def test_a_first_tap_names_a_mark_and_a_second_one_opens_its_page(visit: Visit) -> None:
    visitor = visit(width=390, has_touch=True, is_mobile=True)
    page = visitor.open("/devices/google-p30/")
    figure = page.locator("section:has(#place) figure")
    page.get_by_text("Chart of the crowd").click()
    bar = figure.locator(".barlayer .point path").first
    bar.wait_for()
    bar.scroll_into_view_if_needed()
    box = bar.bounding_box()
    assert box

    def tap() -> None:
        page.touchscreen.tap(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)

    tap()
    note = figure.locator(".named")
    note.wait_for()

    target = note.get_by_role("link").get_attribute("href")
    assert page.url.endswith("/devices/google-p30/")
    tap()
    page.wait_for_url(f"**{target}")
    assert visitor.complaints == []


def test_a_chart_that_cannot_be_fetched_says_so(visit: Visit, site: Site) -> None:
    visitor = visit()
    visitor.page.route("**/figures/**", lambda route: route.abort())

    page = visitor.open(site.pages["session"])

    page.locator("figure .plot").first.get_by_text("This chart could not be drawn").wait_for()


def test_without_scripts_the_numbers_are_all_there_and_filters_work(visit: Visit) -> None:
    visitor = visit(java_script_enabled=False)
    page = visitor.page
    page.goto(f"{visitor.server}/devices/")
    assert page.locator("#rows tbody tr").count() == BARS

    page.locator("select[name=vendor]").select_option("NVIDIA")
    page.get_by_role("button", name="Show", exact=True).click()

    page.wait_for_url("**vendor=NVIDIA**")
    page.locator("#rows tbody tr").get_by_text("P30").wait_for()
    assert page.locator("#rows tbody tr").count() == 1
    page.locator("figure .plot").first.wait_for(state="hidden")
    assert visitor.complaints == []


def test_the_first_tab_stop_skips_to_the_content(visit: Visit) -> None:
    page = visit().open("/about/")

    page.keyboard.press("Tab")
    until(lambda: page.evaluate("document.activeElement.textContent") == "Skip to the content")
    page.keyboard.press("Enter")

    until(lambda: page.evaluate("document.activeElement.id") == "content")


def test_the_keyboard_alone_filters_and_opens_what_a_chart_offers(visit: Visit) -> None:
    visitor = visit()
    page = visitor.open("/devices/")

    page.locator("select[name=vendor]").focus()
    page.keyboard.type("NVIDIA")
    page.wait_for_url("**/devices/?vendor=NVIDIA")
    page.locator(f"{CHANGED}[data-figure$='vendor=NVIDIA']").wait_for()
    page.locator(f"{CHANGED} summary").focus()
    page.keyboard.press("Enter")
    page.locator(f"{CHANGED} .take").get_by_text("CSV", exact=True).wait_for()
    page.keyboard.press("Tab")

    until(lambda: page.evaluate("document.activeElement.textContent") == "CSV")
    outline = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
    assert outline == "solid"
    assert visitor.complaints == []


def test_filters_change_address_figure_and_mean_and_the_way_back_brings_them_back(visit: Visit) -> None:
    visitor = visit()
    page = visitor.open("/devices/")
    bars = page.locator(f"{CHANGED} .bars a")
    visitor.shows(f"{COUNTED}\N{NO-BREAK SPACE}device models", LEAD)
    until(lambda: bars.count() == BARS, seen=bars.count)
    page.evaluate("window.loadedOnce = true")

    page.locator("select[name=vendor]").select_option("Mali")
    page.wait_for_url("**/devices/?vendor=Mali")
    page.locator(f"{CHANGED}[data-figure$='vendor=Mali']").wait_for()

    assert page.evaluate("window.loadedOnce")
    visitor.shows("2\N{NO-BREAK SPACE}device models", LEAD)
    until(lambda: bars.count() == 2, seen=bars.count)

    page.go_back()
    visitor.shows(f"{COUNTED}\N{NO-BREAK SPACE}device models", LEAD)

    page.wait_for_url(f"{visitor.server}/devices/")
    until(lambda: bars.count() == BARS, seen=bars.count)
    assert visitor.complaints == []


def test_on_a_phone_filters_are_one_tap_away_without_scripts(visit: Visit) -> None:
    visitor = visit(width=390, java_script_enabled=False)
    page = visitor.page
    page.goto(f"{visitor.server}/devices/")
    choice = page.locator("select[name=vendor]")
    assert not choice.is_visible()
    form, figure = (
        page.locator("section:has(#filters) .folded").bounding_box(),
        page.locator(CHANGED).bounding_box(),
    )
    assert form["y"] + form["height"] < figure["y"]
    assert form["height"] < 60

    page.locator("section:has(#filters) .folded > summary").click()
    choice.select_option("NVIDIA")
    page.get_by_role("button", name="Show", exact=True).click()

    page.wait_for_url(f"{visitor.server}/devices/?vendor=NVIDIA")
    assert visitor.complaints == []


@pytest.fixture
def taken(visit: Visit, tmp_path: Path) -> Callable[[str, str], bytes]:
    """What a chart's offer of that name downloads to, on the page at that address."""

    def take(address: str, name: str) -> bytes:
        visitor = visit()
        page = visitor.open(address)
        page.locator(f"{CHANGED} summary").click()
        with page.expect_download() as download:
            page.locator(f"{CHANGED} .take").get_by_text(name, exact=True).click()
        download.value.save_as(tmp_path / name)
        assert download.value.suggested_filename == f"frontrunner-speedups.{name.lower()}"
        assert visitor.complaints == []
        return (tmp_path / name).read_bytes()

    return take


def test_a_chart_s_numbers_open_in_pandas(taken: Callable[[str, str], bytes]) -> None:
    pandas = pytest.importorskip("pandas")

    table = pandas.read_csv(io.BytesIO(taken("/devices/?vendor=Mali", "CSV")))
    document = json.loads(taken("/devices/?vendor=Mali", "JSON"))
    rows = pandas.DataFrame(document["rows"])

    assert list(table["device"]) == ["google-pixel-8", "google-pixel-7"]
    assert table["speedup"].dtype == rows["speedup"].dtype == float
    assert table["installations"].sum() == rows["installations"].sum() == 4
    assert document["filters"] == {"vendor": "Mali"}
    assert document["page"].endswith("/devices/?vendor=Mali")
    assert document["licence"]["name"].startswith("CC")


@pytest.fixture
def elsewhere(tmp_path: Path) -> Iterator[str]:
    """Another site: whatever is written into the test's folder."""
    files = partial(SimpleHTTPRequestHandler, directory=str(tmp_path))
    with ThreadingHTTPServer(("127.0.0.1", 0), files) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def test_a_chart_can_be_framed_elsewhere_and_other_pages_cannot(
    visit: Visit, site: Site, tmp_path: Path, elsewhere: str
) -> None:
    drawn = {"speedups-embed": ".bars", "run-stages-embed": "svg.main-svg"}
    (tmp_path / "charts.html").write_text(
        "".join(f'<iframe src="{site.url}{site.pages[name]}" title="{name}"></iframe>' for name in drawn)
    )
    (tmp_path / "home.html").write_text(f'<iframe src="{site.url}/"></iframe>')
    page = visit().page

    page.goto(f"{elsewhere}/charts.html")
    for name, drawing in drawn.items():
        framed = page.frame_locator(f"iframe[title={name}]")
        framed.locator("figure[data-drawn]").wait_for()
        framed.locator("figcaption strong", has_text="n = ").wait_for()
        framed.locator(drawing).first.wait_for()

    with page.expect_console_message(lambda message: "frame-ancestors" in message.text):
        page.goto(f"{elsewhere}/home.html")


def rgb(colour: str) -> str:
    """#rrggbb as browsers compute it."""
    red, green, blue = (int(colour[start : start + 2], 16) for start in (1, 3, 5))
    return f"rgb({red}, {green}, {blue})"
