"""What measuring in a browser costs a visitor of a server: python -m tests.benchmarks.way URL [--wasm].

It counts the bytes that arrive before the first frame is computed, the passes over the recording, the frames,
and the seconds on this machine.
"""

import argparse
import time
from collections import Counter
from collections.abc import Sequence
from typing import Any

from tests.browser.chromium import launched

FLAGS = ("--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader")
WITHOUT_WEBGPU = "delete Navigator.prototype.gpu"
# The passes over the recording, by the worker's messages.
WATCH = """
    window.passes = [];
    const { Worker: Real } = window;
    window.Worker = class extends Real {
        constructor(...given) {
            super(...given);
            this.addEventListener("message", ({ data }) => {
                if (data.type !== "progress" || !["checking", "measuring"].includes(data.phase)) return;
                const name = `${data.phase} ${data.configuration} ${data.run}`;
                window.passes = window.passes.filter((pass) => pass.name !== name);
                window.passes.push({ name, phase: data.phase, frames: data.frame });
                if (data.frame) document.body.dataset.computing = "";
            });
        }
    };
"""
LONGEST_MS = 3_600_000


def kind_of(url: str) -> str:
    """What a visitor downloads, by its address."""
    path = url.partition("//")[2].partition("/")[2]
    kinds = {"sequences": "recording", "modules": "kernels", "shaders": "kernels", "plans": "plans"}
    return kinds.get(path.partition("/")[0], "trajectories" if path.startswith("trajectories") else "page")


def measure(server: str, wasm: bool) -> dict[str, Any]:
    """One session of a first visit: bytes by kind, passes, and seconds from the press of the button."""
    downloaded: Counter[str] = Counter()
    with launched(*FLAGS) as browser:
        page = browser.new_context(viewport={"width": 390, "height": 844}, service_workers="block").new_page()
        page.set_default_timeout(LONGEST_MS)
        page.add_init_script(WATCH + (WITHOUT_WEBGPU if wasm else ""))

        def finished(request: Any) -> None:
            sizes = request.sizes()
            downloaded[kind_of(request.url)] += sizes["responseBodySize"] + sizes["responseHeadersSize"]

        page.on("requestfinished", finished)
        page.goto(f"{server}/measure/", wait_until="networkidle")
        began = time.monotonic()
        page.locator("#start").click()
        page.locator("body[data-computing]").wait_for()
        before_first = dict(downloaded)
        prepared = time.monotonic() - began
        page.locator("#result:not([hidden])").wait_for()
        seconds = time.monotonic() - began
        passes = page.evaluate("window.passes")
    return {"bytes": before_first, "passes": passes, "prepared": prepared, "seconds": seconds}


def report(found: dict[str, Any]) -> list[str]:
    """The measured figures as lines of a table in Markdown."""
    untimed = [one for one in found["passes"] if one["phase"] == "checking"]
    timed = [one for one in found["passes"] if one["phase"] == "measuring"]
    rows = [("bytes before the first frame", f"{sum(found['bytes'].values()) / 1e6:.2f} MB")]
    rows += [(f"- {kind}", f"{count / 1e6:.2f} MB") for kind, count in sorted(found["bytes"].items())]
    rows += [
        ("untimed passes over the recording", str(len(untimed))),
        ("timed passes", str(len(timed))),
        ("frames", str(sum(one["frames"] for one in found["passes"]))),
        ("seconds until the first frame", f"{found['prepared']:.0f}"),
        ("seconds until the result", f"{found['seconds']:.0f}"),
    ]
    return ["| a first visit | |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows)]


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("server")
    parser.add_argument("--wasm", action="store_true", help="measure the processor, by WebAssembly")
    options = parser.parse_args(arguments)
    print("\n".join(report(measure(options.server.rstrip("/"), options.wasm))))


if __name__ == "__main__":
    main()
