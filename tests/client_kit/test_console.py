"""What a participant sees on a terminal and in a log."""

import io
import os

import pytest

from client_kit.console import Console
from tests.builders.screens import Screen


@pytest.fixture(autouse=True)
def _plain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Terminals without colours, whatever this machine's are."""
    monkeypatch.setenv("NO_COLOR", "1")


def test_a_bar_is_drawn_in_place_with_the_time_left_and_makes_way_for_a_line() -> None:
    terminal = Screen()
    console = Console(terminal)

    console.bar("room", 50, 100, " kB")
    console.say("done")

    bar = "room [###############...............] 50/100 kB"
    assert terminal.getvalue() == f"{bar}\r{' ' * len(bar)}\rdone\n"
    Console(terminal).bar("run 2, best", 30, 100, left=75.4)
    assert terminal.getvalue().endswith(" 30/100 1:15 left")


def test_a_log_has_lines_and_no_bars() -> None:
    log = io.StringIO()
    console = Console(log)

    console.bar("room", 50, 100)
    console.lines(["one", "two"])

    assert log.getvalue() == "one\ntwo\n"


def test_a_terminal_without_the_letters_shows_something_all_the_same() -> None:
    raw = io.BytesIO()

    old = io.TextIOWrapper(raw, encoding="ascii")
    Console(old).say("Redmi Note 9 Pro \u7ea2\u7c73")

    assert raw.getvalue().startswith(b"Redmi Note 9 Pro ??")


def test_when_its_reader_is_gone_it_falls_silent() -> None:
    reading, writing = os.pipe()
    os.close(reading)

    with os.fdopen(writing, "w") as stream:
        console = Console(stream)
        console.say("one")
        console.lines(["two", "three"])

        assert console.silent


def test_a_terminal_highlights_the_first_word_of_notes_and_results(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_COLOR")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr("sys.platform", "linux")
    terminal = Screen()

    Console(terminal).lines(["Note: warm", "Speedup of best: 2.00", "Notes: none"])

    assert terminal.getvalue() == (
        "\x1b[1;33mNote:\x1b[0m warm\n\x1b[1;32mSpeedup\x1b[0m of best: 2.00\nNotes: none\n"
    )
