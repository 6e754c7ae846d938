"""python -m tests.benchmarks.loading URL [URL ...]: when a page shows its first chart, after which bytes.

Chromium has a processor four times slower than this one, a slow 4G network and an empty cache. Pages take
turns, so servers of two versions can be compared in one run. Medians of five visits.
"""

from __future__ import annotations

import argparse
from statistics import median
from typing import Any

from tests.browser.chromium import launched
from tests.waiting import until

VISITS = 5
SLOWER = 4
SLOW_4G = {"latency": 150, "downloadThroughput": 1.6e6 / 8, "uploadThroughput": 0.75e6 / 8, "offline": False}
SIZE = {"width": 390, "height": 844}
PATIENCE_SECONDS = 120
# What is drawn: by the server, or by Plotly.
WATCH = """
const look = () => {
    const drawn = document.querySelector("figure.chart > div > svg, figure.chart .main-svg .trace");
    if (drawn?.getBoundingClientRect().height > 0) window.seen = performance.now();
    else requestAnimationFrame(look);
};
requestAnimationFrame(look);
"""
BYTES = """() => [...performance.getEntriesByType("navigation"), ...performance.getEntriesByType("resource")]
    .filter((each) => each.entryType === "navigation" || each.responseEnd <= window.seen)
    .reduce((sum, each) => sum + each.transferSize, 0)"""


def visit(browser: Any, url: str) -> tuple[float, int]:
    """Seconds until the chart is seen, and the bytes of all that had come by then."""
    context = browser.new_context(viewport=SIZE, device_scale_factor=2, service_workers="block")
    page = context.new_page()
    session = context.new_cdp_session(page)
    session.send("Network.enable")
    session.send("Network.emulateNetworkConditions", SLOW_4G)
    session.send("Emulation.setCPUThrottlingRate", {"rate": SLOWER})
    page.add_init_script(WATCH)
    page.goto(url, wait_until="commit", timeout=1000 * PATIENCE_SECONDS)
    # The page's policy forbids what Playwright's own waiting evaluates.
    until(lambda: page.evaluate("window.seen > 0"), PATIENCE_SECONDS)
    found = page.evaluate("window.seen") / 1000, page.evaluate(BYTES)
    context.close()
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("urls", nargs="+", metavar="URL")
    urls = parser.parse_args().urls
    visits: dict[str, list[tuple[float, int]]] = {url: [] for url in urls}
    with launched() as browser:
        for _ in range(VISITS):
            for url in urls:
                visits[url].append(visit(browser, url))
    for url, each in visits.items():
        seconds, sizes = zip(*each, strict=True)
        print(
            f"{url}: chart after {median(seconds):.1f} s ({min(seconds):.1f} to {max(seconds):.1f}), ", end=""
        )
        print(f"{median(sizes) / 1000:.0f} kB before it")


if __name__ == "__main__":
    main()
