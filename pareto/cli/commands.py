"""The commands of `python -m pareto`, which is `frontrunner tune`."""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import suppress
from importlib import import_module
from typing import TYPE_CHECKING

from groundwork import terminal
from groundwork.command_line import USAGE_ERROR, Parser
from pareto.errors import ParetoError

if TYPE_CHECKING:
    from pareto.measuring.hosts import Host

COMMANDS = {
    "explore": "measure configurations until the budget is spent",
    "front": "print the non-dominated points, or the best one for a purpose",
    "plot": "draw an exploration as one HTML file that needs no network",
    "runs": "list many explorations on one HTML page",
    "space": "check a space and print its size, or convert it",
    "compare": "correlate devices over their common configurations",
    "transfer": "order another device's front by the values expected here",
}


def main(arguments: list[str] | None = None, prog: str = "python -m pareto", host: Host | None = None) -> int:
    """Run the command line as the program `prog`; return its exit code. `host` serves workers on other hosts.

    0 done, 1 nothing succeeded, 2 usage, 130 interrupted with everything saved.
    """
    words = sys.argv[1:] if arguments is None else arguments
    loaded = False
    try:
        parser = make_parser(words, prog)
        loaded = True
        options = parser.parse_args(words, argparse.Namespace(host=host))
        code = int(options.act(options))
        sys.stdout.flush()
        return code
    except SystemExit as ended:  # of the parser: it has reported a wrong command line, or printed the help
        if ended.code != USAGE_ERROR:
            raise
        return USAGE_ERROR
    except ParetoError as error:
        terminal.fail(str(error))
        return USAGE_ERROR
    except ModuleNotFoundError as missing:
        package = (missing.name or "").split(".")[0]
        if package == "pareto":
            raise
        terminal.fail(f"searching needs {package}: pip install 'frontrunner[explore]'")
        return USAGE_ERROR
    except BrokenPipeError:  # | head: the reader has closed the pipe, which is not an error
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        terminal.fail(f"{error.filename or 'cannot write'}: {error.strerror or error}")
        return USAGE_ERROR
    except KeyboardInterrupt as interrupt:
        state = "interrupted; the same command goes on from here" if loaded else "interrupted before it began"
        with suppress(OSError):  # SIGHUP: the terminal was closed
            sys.stderr.write("\n")
            terminal.note(str(interrupt) or state)
        return 130


def make_parser(words: list[str], prog: str) -> Parser:
    """The parser, in which the options of the command that `words` begin with are read."""
    parser = Parser.of_program(prog, "Search for the best configurations of a program.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, purpose in COMMANDS.items():
        command = commands.add_parser(name, help=purpose)
        # The others are not imported: their packages may be missing, and importing takes a second.
        if name in words[:1]:
            import_module(f"pareto.cli.{name}").add_arguments(command)
    return parser
