"""An observer of a session that calls functions of a test."""

from collections.abc import Callable
from typing import Any

from client_kit.measuring.measurement import Observer
from client_kit.measuring.session import Run


class Calling(Observer):
    """Calls `on_frame`, `on_run`, `on_contention` and `rest` where they are given, and never rests itself."""

    def __init__(self, **calls: Callable[..., Any]) -> None:
        self._calls = calls

    def frame(self, *frame: Any) -> None:
        self._call("on_frame", *frame)

    def run(self, run: Run) -> None:
        self._call("on_run", run)

    def contention(self) -> None:
        self._call("on_contention")

    def rest(self, seconds: float) -> None:
        self._call("rest", seconds)

    def _call(self, name: str, *values: Any) -> None:
        if name in self._calls:
            self._calls[name](*values)
