"""The Firefox that is installed on this machine, driven through Marionette."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from tests.browser.chromium import NoBrowserError, no_browser
from tests.waiting import PATIENCE_SECONDS, until

NAMES = ("firefox-esr", "firefox")
# The C library's AVX-512 functions leave registers in a state in which Firefox's own mixture of SSE and AVX
# is twenty times slower on some processors (seen with Firefox 140 and glibc 2.36 on a Sapphire Rapids).
WITHOUT_AVX512 = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX512VL,-AVX512BW"}
# As a script of the page: Marionette's own may not import modules.
CALL = """
const [text, argument, done] = arguments;
window.addEventListener("answer", ({ detail }) => done(detail), { once: true });
const script = document.createElement("script");
script.textContent = `(async () => {
    let answer;
    try {
        answer = { value: await (${text})(JSON.parse(${JSON.stringify(argument)})) };
    } catch (error) {
        answer = { error: String(error) };
    }
    dispatchEvent(new CustomEvent("answer", { detail: JSON.stringify(answer) }));
})()`;
document.head.append(script);
"""


class FirefoxPage:
    """The one tab, with what tests ask of Playwright's pages."""

    def __init__(self, marionette: Any) -> None:
        self.marionette = marionette

    def goto(self, url: str) -> None:
        """Open `url`, and wait until it is loaded."""
        self.marionette.navigate(url)

    def evaluate(self, function: str, argument: object = None) -> Any:
        """What a function of JavaScript, or its promise, gives for `argument` on the page, as JSON."""
        answer = self.marionette.execute_async_script(
            CALL, script_args=(function, json.dumps(argument)), script_timeout=300_000
        )
        found = json.loads(answer)
        if "error" in found:
            raise AssertionError(found["error"])
        return found.get("value")

    def click(self, selector: str) -> None:
        """Click what `selector` finds, once it is there."""
        self.wait_for(f"document.querySelector('{selector}')").click()

    def wait_for(self, condition: str) -> Any:
        """What the expression `condition` gives on the page, once that is true."""

        def value_of(expression: str) -> Any:
            return self.marionette.execute_script(f"return {expression}")

        return until(lambda: value_of(condition), pause=0.2, seen=lambda: value_of("document.body.innerText"))


@contextmanager
def launched(preferences: dict[str, Any] | None = None) -> Iterator[FirefoxPage]:
    """A running browser. Raises NoBrowserError where none, or no driver, is installed."""
    executable = next((path for name in NAMES if (path := shutil.which(name))), None)
    if executable is None:
        raise no_browser(f"no browser: none of {', '.join(NAMES)} is on the PATH")
    try:
        from marionette_driver.marionette import Marionette
    except ImportError as error:
        raise no_browser(f"marionette-driver cannot be imported: {error}") from error
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        # An idle connection would keep a thread of the server busy for two minutes.
        wanted = {"marionette.port": port, "network.http.keep-alive.timeout": 1, **(preferences or {})}
        lines = (f"user_pref({json.dumps(name)}, {json.dumps(value)});\n" for name, value in wanted.items())
        with open(f"{profile}/user.js", "w", encoding="utf-8") as file:
            file.writelines(lines)
        command = [executable, "--headless", "--marionette", "--no-remote", "--profile", profile]
        quiet, environment = subprocess.DEVNULL, os.environ | WITHOUT_AVX512
        with subprocess.Popen(command, stdout=quiet, stderr=quiet, env=environment) as process:
            try:
                marionette = Marionette(host="127.0.0.1", port=port)
                marionette.raise_for_port(timeout=PATIENCE_SECONDS)
                marionette.start_session()
                yield FirefoxPage(marionette)
                marionette.delete_session()
            finally:
                process.terminate()


@pytest.fixture(scope="package")
def firefox() -> Iterator[FirefoxPage]:
    """The installed Firefox, started once; a skip with its reason where there is none."""
    try:
        with launched() as page:
            yield page
    except NoBrowserError as reason:
        pytest.skip(str(reason))
