"""The argument parser of all commands."""

from __future__ import annotations

import argparse
import sys
from typing import NoReturn

from groundwork import __version__, terminal

USAGE_ERROR = 2


class Parser(argparse.ArgumentParser):
    """Knows --version, and reports a wrong command line as every other error: one line, exit code 2."""

    @classmethod
    def of_program(cls, prog: str, description: str, epilog: str | None = None) -> Parser:
        """The parser of a whole program, with --version."""
        parser = cls(prog=prog, description=description, epilog=epilog)
        parser.add_argument("--version", action="version", version=f"frontrunner {__version__}")
        return parser

    def error(self, message: str) -> NoReturn:
        """Print `message` and end the program."""
        terminal.fail(f"{message} (see {self.prog} --help)")
        sys.exit(USAGE_ERROR)
