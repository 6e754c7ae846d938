"""`frontrunner measure | doctor | tune | worker | slam | paper | serve | admin`.

Each command hands its words to the program that does the work; that program is loaded only then, so that a
participant needs no server and a researcher no client.
"""

import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from groundwork import __version__, terminal

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from pareto.measuring.hosts import Hosted, Hosting

USAGE = """\
usage: frontrunner COMMAND ...

Pareto fronts of dense SLAM: measure them, search for them, publish them.

commands:
  measure   measure this device and send the result; also status, send, export, erase, choose, ...
  doctor    whether this device can measure
  tune      search for the best configurations of your program: explore, front, plot, space, ...
  worker    measure for a search on another host
  slam      run and compare SLAM configurations over a sequence
  paper     measure the figures of the paper again, beside its numbers
  serve     start a server on this machine
  admin     manage a server: migrate, backup, front, exploration, results, ...

options:
  -h, --help   show this help; `frontrunner COMMAND --help` shows a command's own
  --version    show the version
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out one command and return its exit code; 2 where there is no such command."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if not words or words[0] in ("-h", "--help"):
        sys.stdout.write(USAGE)
        return 0 if words else 2
    if words[0] == "--version" or (words[0] in COMMANDS and words[1:] == ["--version"]):
        sys.stdout.write(f"frontrunner {__version__}\n")
        return 0
    command = COMMANDS.get(words[0])
    if command is None:
        terminal.fail(f"{words[0]!r} is not a command: use one of {', '.join(COMMANDS)}")
        return 2
    return command(words[1:])


def _measure(words: list[str]) -> int:
    from client_kit.__main__ import COMMANDS as VERBS
    from client_kit.__main__ import main as client

    named = bool(words) and words[0] in VERBS
    return client(words if named else ["run", *words], prog="frontrunner measure")


def _doctor(words: list[str]) -> int:
    from client_kit.__main__ import main as client

    return client(["doctor", *words], prog="frontrunner")


def _tune(words: list[str]) -> int:
    from pareto.cli.commands import main as pareto

    return pareto(words, prog="frontrunner tune", host=_host)


def _host(hosting: "Hosting") -> "AbstractContextManager[Hosted]":
    from frontrunner.lease_server import hosted

    return hosted(hosting)


def _worker(words: list[str]) -> int:
    from frontrunner.worker import main as worker

    return worker(words)


def _slam(words: list[str]) -> int:
    from slam.__main__ import main as slam

    return slam(words, prog="frontrunner slam")


def _paper(words: list[str]) -> int:
    try:
        from frontrunner.paper.command import main as paper
    except ModuleNotFoundError as missing:
        package = (missing.name or "").split(".")[0]
        if package in ("frontrunner", "pareto", "slam"):
            raise
        terminal.fail(f"the paper needs {package}: pip install 'frontrunner[explore,elasticfusion]'")
        return 2
    return paper(words)


def _serve(words: list[str]) -> int:
    return _administer(["frontrunner", "serve", *words])


def _admin(words: list[str]) -> int:
    return _administer(["frontrunner admin", *words])


def _administer(arguments: list[str]) -> int:
    try:
        from crowd.__main__ import main as administration
    except ModuleNotFoundError as missing:
        package = (missing.name or "").split(".")[0]
        if package == "crowd":
            raise
        terminal.fail(f"a server needs {package}: pip install 'frontrunner[server]'")
        return 2
    return administration(arguments)


COMMANDS: dict[str, Callable[[list[str]], int]] = {
    "measure": _measure,
    "doctor": _doctor,
    "tune": _tune,
    "worker": _worker,
    "slam": _slam,
    "paper": _paper,
    "serve": _serve,
    "admin": _admin,
}

if __name__ == "__main__":
    sys.exit(main())
