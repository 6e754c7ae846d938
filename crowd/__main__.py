"""Django's command line for this project: serve, migrate, front, exploration, backup and the rest."""

import os
import sqlite3
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from typing import NoReturn

from django.core.management import BaseCommand, ManagementUtility, get_commands
from django.core.management.base import CommandError, CommandParser, SystemCheckError
from django.db import DatabaseError

from crowd.database import damage
from groundwork import __version__, terminal
from groundwork.command_line import USAGE_ERROR

TRACEBACK = "--traceback"


class CommandLine(ManagementUtility):
    """Django's commands, of which an unknown one is an error like all others."""

    def fetch_command(self, subcommand: str) -> BaseCommand:
        """The command `subcommand`. Raises CommandError if it does not exist."""
        commands = get_commands()
        if subcommand not in commands:
            close = get_close_matches(subcommand, commands, 1)
            hint = f"did you mean {close[0]}?" if close else f"see {self.prog_name} help"
            raise CommandError(f"{subcommand!r} is not a command: {hint}", returncode=USAGE_ERROR)
        return super().fetch_command(subcommand)


def main(arguments: Sequence[str]) -> int:
    """Carry out the command in `arguments`, the name of the program first; return its exit code."""
    if "--version" in arguments[1:]:  # Django would print its own
        sys.stdout.write(f"frontrunner {__version__}\n")
        return 0
    os.environ.setdefault("DJANGO_SETTINGS_MODULE", "crowd.settings")
    # What a server writes is for its own user: the database holds log-ins, counters hold addresses.
    os.umask(0o077)
    from crowd.observability.environment import SettingError

    try:
        import crowd.settings  # noqa: F401 - Django would hide the reason
    except SettingError as error:
        terminal.fail(str(error))
        return 1
    # Checks of the code run in `make check`; in a deployment they would double the start of each command.
    BaseCommand.requires_system_checks = []
    # Django makes the parsers of all commands itself, and has no setting for the text of usage errors.
    CommandParser.error = _usage_error  # type: ignore[assignment, method-assign]
    try:
        CommandLine(_raising(arguments)).execute()
    except SystemCheckError as error:  # a report of many lines
        sys.stderr.write(f"{error}\n")
        return error.returncode
    except CommandError as error:
        if TRACEBACK in arguments:
            raise
        terminal.fail(str(error))
        return error.returncode
    except (DatabaseError, sqlite3.Error, damage.DamagedError) as error:
        if TRACEBACK in arguments or (message := damage.describe(error)) is None:
            raise
        terminal.fail(message)
        return 1
    except KeyboardInterrupt:
        return 130  # as a shell says of a program that Ctrl-C ended
    return 0


def _usage_error(parser: CommandParser, message: str) -> NoReturn:
    raise CommandError(f"{message} (see {parser.prog} --help)", returncode=USAGE_ERROR)


def _raising(arguments: Sequence[str]) -> list[str]:
    """`arguments` with which a command raises a CommandError instead of printing it with Django's prefix."""
    program, *rest = arguments
    if not rest or rest[0] == "help" or rest[0].startswith("-"):
        return [program, *rest]
    return [program, rest[0], TRACEBACK, *rest[1:]]


if __name__ == "__main__":
    sys.exit(main(sys.argv))
