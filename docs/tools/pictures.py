"""Makes the pictures of the guide from a running server and from commands.

    FRONTRUNNER_VAR=demo frontrunner serve --demo
    python docs/tools/pictures.py pages --server http://127.0.0.1:8000
    python docs/tools/pictures.py measuring --server http://127.0.0.1:8000  (of an ordinary server)
    python docs/tools/pictures.py admin --server http://127.0.0.1:8000      (FRONTRUNNER_ADMIN=NAME:PASSWORD)
    python docs/tools/pictures.py publishing --server http://127.0.0.1:8000 (of a draft)
    python docs/tools/pictures.py terminal --server http://127.0.0.1:8000
    python docs/tools/pictures.py search --folder run
    python docs/tools/pictures.py sequence

`pages` and `exploration` need a demo server, whose pages say so. `diagrams.py` draws the diagrams.
"""

import argparse
import io
import json
import os
import re
import subprocess
import sys
import textwrap
import urllib.request
from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import sync_playwright

ROOT = Path(__file__).resolve().parents[2]
PICTURES = ROOT / "docs" / "pictures"
MOST_BYTES = 150_000
# As the tests of pages start it: this Chromium computes on the processor.
FLAGS = (
    "--no-sandbox",
    "--disable-background-networking",
    "--enable-unsafe-webgpu",
    "--use-webgpu-adapter=swiftshader",
)


def save(name: str, png: bytes, width: int = 1000) -> None:
    """Write a PNG of at most `width` pixels and MOST_BYTES bytes, in as many colours as fit."""
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    if picture.width > width:
        picture = picture.resize(
            (width, round(picture.height * width / picture.width)), Image.Resampling.LANCZOS
        )
    for colours in (256, 128, 64, 32):
        out = io.BytesIO()
        # Maximum coverage keeps the colours of small marks, which the median cut merges.
        few = picture.quantize(colours, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
        few.save(out, "PNG", optimize=True)
        if out.tell() < MOST_BYTES:
            break
    (PICTURES / f"{name}.png").write_bytes(out.getvalue())
    print(f"{name}.png {out.tell() // 1000} kB, {colours} colours")


class Camera:
    """A browser that photographs pages."""

    def __init__(self, server: str) -> None:
        self.server = server.rstrip("/")

    def __enter__(self) -> "Camera":
        self._playwright = sync_playwright().start()
        executable = os.environ.get("FRONTRUNNER_CHROMIUM", "/usr/bin/chromium")
        self.browser = self._playwright.chromium.launch(executable_path=executable, args=list(FLAGS))
        self.context = self.browser.new_context(viewport={"width": 1200, "height": 800})
        return self

    def __exit__(self, *_: object) -> None:
        self.browser.close()
        self._playwright.stop()

    def log_in(self) -> None:
        """Log in to the administration as FRONTRUNNER_ADMIN (NAME:PASSWORD)."""
        name, _, password = os.environ["FRONTRUNNER_ADMIN"].partition(":")
        page = self.context.new_page()
        page.goto(f"{self.server}/admin/login/")
        page.fill("#id_username", name)
        page.fill("#id_password", password)
        page.locator("[type=submit]").first.click()
        page.wait_for_load_state("networkidle")
        page.close()

    def shoot(
        self, name: str, path: str, height: int, width: int = 1200, opens: str = "", scroll: str = ""
    ) -> None:
        """The first `height` pixels of the page at `path`, or from the element `scroll` on."""
        page = self.context.new_page()
        page.set_viewport_size({"width": width, "height": height})
        page.goto(f"{self.server}{path}" if path.startswith("/") else path, wait_until="networkidle")
        if opens:
            page.locator(opens).first.click()
        if scroll:
            page.locator(scroll).first.evaluate("element => element.scrollIntoView()")
        page.wait_for_timeout(3000)  # for charts; the pages' policy forbids wait_for_function
        save(name, page.screenshot(), width=min(width, 1000))
        page.close()


def answer(server: str, path: str) -> Any:
    with urllib.request.urlopen(f"{server}/api/v1{path}") as response:
        return json.load(response)


def pages(server: str) -> None:
    [device, *_] = answer(server, "/speedups?limit=20")["results"]
    version = answer(server, "/fronts")["results"][0]["version"]
    with Camera(server) as camera:
        camera.shoot("home", "/", 1000, width=1400)
        camera.shoot("device", f"/devices/{device['device']}/", 1600)
        camera.shoot("front", f"/fronts/{version}/", 2160)
        camera.shoot("recommend", "/recommend/?gpu=Adreno&max_ate=0.05", 1300)
        camera.shoot("../research/pictures/transfer", "/transfer/", 1100)


def measuring(server: str) -> None:
    with Camera(server) as camera:
        camera.shoot("measure", "/measure/", 800)
        camera.shoot("phone", "/measure/", 780, width=390)
        camera.shoot("consent", "/measure/", 900, opens="text=What is sent", scroll="text=What is sent")


def exploration(server: str) -> None:
    key = answer(server, "/explorations")["results"][0]["id"]
    with Camera(server) as camera:
        camera.shoot("exploration", f"/explorations/{key}/", 1000)


def admin(server: str) -> None:
    with Camera(server) as camera:
        camera.log_in()
        camera.shoot("admin", "/admin/", 800)
        camera.shoot("admin-devices", "/admin/devices/devicemodel/", 700)


def publishing(server: str) -> None:
    """From the points of the newest exploration to the confirmation; its draft goes into review."""
    key = answer(server, "/explorations")["results"][0]["id"]
    with Camera(server) as camera:
        camera.log_in()
        camera.shoot("choose-points", f"/admin/explorations/exploration/{key}/points/", 900)
        page = camera.context.new_page()
        page.goto(f"{server}/admin/fronts/frontversion/?state__exact=draft")
        draft = page.locator("#result_list tbody th a").first.get_attribute("href") or ""
        camera.shoot("draft", draft, 900)
        page.goto(f"{server}{draft}")
        page.get_by_role("button", name="Submit").click()
        page.wait_for_load_state("networkidle")
        page.get_by_role("button", name="Publish").click()
        page.wait_for_load_state("networkidle")
        page.set_viewport_size({"width": 1200, "height": 450})
        save("confirmation", page.screenshot())


def terminal(name: str, text: str, command: str) -> None:
    """`text` as a terminal shows it after `command`, as SVG."""
    lines = [f"$ {command}", *text.splitlines()]
    width, height = 24 + max(len(line) for line in lines) * 7.3, 24 + len(lines) * 17
    rows = "".join(
        f'<tspan x="12" y="{24 + 17 * number}">{escape(line) or " "}</tspan>'
        for number, line in enumerate(lines)
    )
    (PICTURES / f"{name}.svg").write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height}" width="{width:.0f}" '
        f'height="{height}"><rect width="100%" height="100%" rx="8" fill="#131b20"/>'
        f'<text xml:space="preserve" fill="#e8eef0" font-size="12" '
        f'font-family="ui-monospace, DejaVu Sans Mono, Menlo, monospace">{rows}</text></svg>\n',
        encoding="utf-8",
    )


def run(*words: str) -> str:
    command = [sys.executable, "-m", "frontrunner", *words]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=True, stdin=subprocess.DEVNULL
    )
    return done.stdout


def terminals(server: str) -> None:
    words = ("measure", "--server", server, "--yes", "--no-probes")
    measured = run(*words)
    lines = measured[measured.index("Order:") :].splitlines()
    # A private link is nobody else's business.
    shown = [re.sub(r"/mine/\S+", "/mine/...", line) for line in lines]
    terminal("terminal-run", "\n".join(shown), " ".join(("frontrunner", *words)))
    table = run("slam", "run", "--set", "compute_size_ratio=2").partition("\nmean ... max")[0]
    lines = [
        part
        for line in table.strip().splitlines()
        for part in (textwrap.wrap(line, 96) if len(line) > 96 else [line])
    ]
    terminal("terminal-slam", "\n".join(lines), "frontrunner slam run --set compute_size_ratio=2")


def search(folder: Path) -> None:
    with Camera("") as camera:
        page = (folder / "front.html").resolve().as_uri()
        camera.shoot("search-page", page, 1000, scroll="text=Front over time")
        camera.shoot("tutorial", page, 950)


def sequence() -> None:
    """Depth and colour of one frame of the living room, side by side."""
    import tempfile

    import numpy as np

    sys.path.insert(0, str(ROOT))
    from slam.datasets import open_sequence

    with tempfile.TemporaryDirectory() as folder:
        run(
            "slam",
            "datasets",
            "make",
            "living-room",
            "--out",
            f"{folder}/room",
            "--frames",
            "2",
            "--format",
            "tum",
        )
        room = open_sequence(Path(folder) / "room")
        depth, colour = room.depth(1).astype(float), room.colour(1)
    assert colour is not None
    near, far = np.percentile(depth[depth > 0], (1, 99))
    grey = np.where(depth > 0, 255 - 215 * np.clip((depth - near) / (far - near), 0, 1), 0).astype(np.uint8)
    both = np.concatenate([np.repeat(grey[:, :, None], 3, axis=2), colour], axis=1)
    out = io.BytesIO()
    Image.fromarray(both).save(out, "PNG")
    save("living-room", out.getvalue())


ACTIONS: dict[str, Callable[[argparse.Namespace], None]] = {
    "pages": lambda options: pages(options.server),
    "measuring": lambda options: measuring(options.server),
    "exploration": lambda options: exploration(options.server),
    "admin": lambda options: admin(options.server),
    "publishing": lambda options: publishing(options.server),
    "terminal": lambda options: terminals(options.server),
    "search": lambda options: search(options.folder),
    "sequence": lambda _: sequence(),
}


def main() -> None:
    parser = argparse.ArgumentParser(description="Make the pictures of the guide.")
    parser.add_argument("what", choices=ACTIONS)
    parser.add_argument("--server", default="http://127.0.0.1:8000")
    parser.add_argument("--folder", type=Path, default=Path("run"))
    options = parser.parse_args()
    ACTIONS[options.what](options)


if __name__ == "__main__":
    main()
