"""A whole `run` that ends itself by SIGKILL at the N-th line of the client's own code; a program.

`python -m tests.client_kit.killed FOLDER SERVER STRIDE` runs once to count the lines, then again and again
in forked children, each with a home of its own, killed STRIDE lines later than the one before, and after
each a second `run`, of one session, without disturbance. It prints, as JSON, how many lines there are and
for each kill the line's place and what the spool held after the kill and at the end. Measuring is canned: it
is what comes before, after and between the runs that may lose or double a session. No OpenCL is touched,
which does not survive a fork.
"""

import json
import os
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Any

from msgspec.structs import replace

import client_kit
from client_kit.console import Console, NullStream
from client_kit.delivery.spool import Spool
from client_kit.device import preflight
from client_kit.home import Home
from client_kit.measuring import measurement
from client_kit.measuring.measurement import Observer, Task
from client_kit.measuring.session import Session
from client_kit.participating import participation
from client_kit.participating.participation import RunOptions
from tests.client_kit import canned

CLIENT = Path(client_kit.__file__).parent
# Between two lines of these, which compute and print, nothing changes that a killed process leaves behind.
PURE = {str(CLIENT / name) for name in ("console.py", "measuring/session.py", "participating/summary.py")}


class Lines:
    """Counts lines of the client's code and kills this process at one of them."""

    def __init__(self, last: int | None) -> None:
        self.count, self._last = 0, last
        self.place = ""

    def __call__(self, frame: FrameType, event: str, _: Any) -> Any:
        file = frame.f_code.co_filename
        if file in PURE or not file.startswith(str(CLIENT)):
            return None
        if event == "line":
            self.count += 1
            if self.count == self._last:
                os.kill(os.getpid(), signal.SIGKILL)
        return self


def run(home: Home, server: str, sessions: int, last: int | None = None) -> int:
    """One `run` of `sessions`, killed at line `last`; how many lines it had."""
    lines = Lines(last)
    sys.settrace(lines)
    try:
        home.prepare()
        options = RunOptions(server, yes=True, sessions=sessions)
        participation.run(options, home, Console(NullStream()), pause=lambda _: None)
    finally:
        sys.settrace(None)
    return lines.count


def forked(home: Home, server: str, sessions: int, last: int | None = None) -> int:
    """`run` in a child; its wait status."""
    child = os.fork()
    if not child:
        try:
            run(home, server, sessions, last)
        except BaseException as error:
            print(repr(error), file=sys.stderr)
            os._exit(1)
        os._exit(0)
    return os.waitpid(child, 0)[1]


def states(home: Home) -> list[str]:
    """The states of the sessions in a home's spool, drafts last; none where it does not exist yet."""
    if not home.path.is_dir():
        return []
    spool = Spool(home.spool)
    return [item.state for item in spool.items() + spool.drafts()]


def ready(task: Task, _device: Any, observer: Observer, *_: Any) -> tuple[Session, bool]:
    whole = canned.measured(task.asked, task.plan)
    for finished in range(1, len(whole.runs) + 1):
        observer.session(replace(whole, runs=whole.runs[:finished]))
    return whole, False


def main(folder: Path, server: str, stride: int) -> None:
    measurement.measure = ready  # type: ignore[assignment]
    participation._device = lambda *_: (canned.DEVICE, canned.IDENTITY)  # type: ignore[assignment]
    preflight.concerns = lambda *_, **__: []
    total = run(Home(folder / "whole"), server, 2)
    kills = []
    for last in range(1, total, stride):
        home = Home(folder / str(last))
        killed = forked(home, server, 2, last)
        after = states(home)
        finished = forked(home, server, 1)
        kills.append({"line": last, "status": [killed, finished], "after": after, "end": states(home)})
    print(json.dumps({"lines": total, "kills": kills}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]))
