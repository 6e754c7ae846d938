"""Messages, colours and progress of all commands."""

import sys

import pytest
from django.core.management.base import CommandParser

from client_kit.__main__ import main as client
from crowd.__main__ import main as administration
from frontrunner.__main__ import COMMANDS
from frontrunner.__main__ import main as frontrunner
from groundwork import __version__, terminal
from pareto.cli.commands import main as pareto
from slam.__main__ import main as slam
from tests.builders.screens import Screen


def colour_terminal(monkeypatch: pytest.MonkeyPatch) -> Screen:
    """A terminal with colours as standard error; not a fixture, after which pytest replaces it."""
    stream = Screen()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    return stream


def test_a_terminal_shows_errors_and_warnings_in_colour(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = colour_terminal(monkeypatch)
    terminal.fail("no such file")
    terminal.warn("one value only")
    terminal.note("done")

    assert screen.getvalue() == (
        "\x1b[1;31mfrontrunner:\x1b[0m no such file\n"
        "frontrunner: \x1b[1;33mwarning:\x1b[0m one value only\n"
        "frontrunner: done\n"
    )


@pytest.mark.parametrize("variable", [("NO_COLOR", "1"), ("TERM", "dumb")])
def test_colours_can_be_switched_off(monkeypatch: pytest.MonkeyPatch, variable: tuple[str, str]) -> None:
    screen = colour_terminal(monkeypatch)
    monkeypatch.setenv(*variable)
    terminal.fail("no such file")

    assert screen.getvalue() == "frontrunner: no such file\n"


def test_a_log_has_no_colours_and_no_progress(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.fail("no such file")

    assert capsys.readouterr().err == "frontrunner: no such file\n"
    assert terminal.progress_line() is None


def test_a_terminal_shows_one_line_of_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = colour_terminal(monkeypatch)
    monkeypatch.setenv("NO_COLOR", "1")
    show = terminal.progress_line("mu=0.1: ")
    assert show is not None
    for done in (1, 2, 3):
        show(done, 3)

    text = screen.getvalue()
    assert text.count("\n") == 1
    parts = [part.split(",")[0] for part in text.split("\r")[1:]]
    assert parts == [f"mu=0.1: frame {done}/3" for done in (1, 2, 3)]
    assert text.endswith("0 s left\x1b[K\n")


def test_progress_counts_in_larger_units(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = colour_terminal(monkeypatch)
    monkeypatch.setenv("NO_COLOR", "1")
    show = terminal.progress_line(unit="MB", scale=10**6)
    assert show is not None
    show(0, 12_000_000)
    show(12_000_000, 12_000_000)

    first, last = screen.getvalue().split("\r")[1:]
    assert first.startswith("MB 0/12\x1b[K")
    assert last.startswith("MB 12/12, ")


@pytest.mark.parametrize("program", [client, pareto, slam])
def test_a_wrong_command_line_is_one_line_with_the_common_prefix(program, capsys) -> None:
    try:
        code = program(["nosuch"])
    except SystemExit as ended:
        code = ended.code

    error = capsys.readouterr().err
    assert code == 2
    assert error.startswith("frontrunner: argument COMMAND: invalid choice: 'nosuch'")
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nosuch"], "'nosuch' is not a command: see manage.py help"),
        (["migrat"], "'migrat' is not a command: did you mean migrate?"),
        (["migrate", "--nosuch"], "unrecognized arguments: --nosuch (see manage.py migrate --help)"),
        (
            ["front", "publish"],
            "the following arguments are required: FILE|VERSION (see manage.py front publish --help)",
        ),
    ],
)
def test_a_wrong_command_line_of_a_server_is_one_line_with_the_common_prefix(
    words: list[str], message: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(CommandParser, "error", CommandParser.error)  # which this command line replaces

    assert administration(["manage.py", *words]) == 2
    assert capsys.readouterr().err == f"frontrunner: {message}\n"


@pytest.mark.parametrize("words", [["--version"], ["serve", "--version"]])
def test_a_server_shows_the_version_of_this_project(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert administration(["manage.py", *words]) == 0
    assert capsys.readouterr().out == f"frontrunner {__version__}\n"


@pytest.mark.parametrize("words", [[], *([name] for name in COMMANDS)])
def test_every_command_shows_the_version(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert frontrunner([*words, "--version"]) == 0
    assert capsys.readouterr().out == f"frontrunner {__version__}\n"
