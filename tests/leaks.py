"""What a test leaves behind fails that test, not its neighbour: processes, and threads that never end.

What a fixture of a wider scope starts may stay until that fixture ends.
"""

import gc
import os
import subprocess
import sys
import threading
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

from tests.waiting import until

PATIENCE_SECONDS = 20.0  # for what is ending already
_allowed: set[object] = set()  # what ran before the tests, and what fixtures of wider scopes started
_starts = 0  # of processes, so that only tests which start one look for it


def _count(event: str, _arguments: tuple[object, ...]) -> None:
    global _starts
    if event in {"subprocess.Popen", "os.fork", "os.posix_spawn"}:
        _starts += 1


sys.addaudithook(_count)


def children() -> set[object]:
    """The ids of this process's children that run: zombies have ended, and wait for their parent."""
    found: set[object] = set()
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, parent = status.read_text().rpartition(")")[2].split()[:2]
        except OSError:  # it ended meanwhile
            continue
        if int(parent) == os.getpid() and state != "Z":
            found.add(int(status.parent.name))
    return found


def threads() -> set[object]:
    """The threads that would keep this process alive."""
    return {thread for thread in threading.enumerate() if not thread.daemon}


def allow(process: subprocess.Popen[bytes], instead_of: subprocess.Popen[bytes]) -> None:
    """Let `process` stay where the process `instead_of` which it runs might: a fixture ends it."""
    if instead_of.pid in _allowed:
        _allowed.add(process.pid)


def _named(one: object) -> str:
    if isinstance(one, threading.Thread):
        return f"the thread {one.name}"
    try:
        return f"the process {Path(f'/proc/{one}/cmdline').read_text().replace(chr(0), ' ')}"
    except OSError:
        return f"the process {one}"


def pytest_sessionstart() -> None:
    _allowed.update(children() | threads())


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: Any) -> Generator[None, Any, Any]:
    if fixturedef.scope == "function":
        return (yield)
    started, before = _starts, threads()
    try:
        return (yield)
    finally:
        _allowed.update(threads() - before)
        if _starts > started:
            _allowed.update(children())


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, Any, Any]:
    item.stash[_STARTED] = _starts
    return (yield)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_teardown(item: pytest.Item) -> Generator[None, Any, Any]:
    result = yield
    look = children if _starts > item.stash[_STARTED] else set

    def left() -> set[object]:
        return (look() | threads()) - _allowed

    if left():
        gc.collect()  # threads of an executor end with it
    try:
        until(lambda: not left(), PATIENCE_SECONDS)
    except AssertionError:
        found = left()
        _allowed.update(found)  # they are reported once
        pytest.fail(f"the test left behind {', '.join(map(_named, found))}", pytrace=False)
    return result


_STARTED = pytest.StashKey[int]()
