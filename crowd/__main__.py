"""Django's command line for this project: serve, migrate, front, exploration, backup and the rest."""

import os
import sys
from collections.abc import Sequence

from frontrunner import terminal

TRACEBACK = "--traceback"


def main(arguments: Sequence[str]) -> int:
    """Carry out the command in ARGUMENTS, the name of the program first; return its exit code."""
    os.environ.setdefault("DJANGO_SETTINGS_MODULE", "crowd.settings")
    from crowd.operations.environment import SettingError

    try:
        import crowd.settings  # noqa: F401 - Django would hide the reason
    except SettingError as error:
        terminal.fail(str(error))
        return 1
    from django.core.management import execute_from_command_line
    from django.core.management.base import CommandError, SystemCheckError

    try:
        execute_from_command_line(_raising(arguments))
    except SystemCheckError as error:  # a report of many lines
        sys.stderr.write(f"{error}\n")
        return error.returncode
    except CommandError as error:
        if TRACEBACK in arguments:
            raise
        terminal.fail(str(error))
        return error.returncode
    except KeyboardInterrupt:
        return 130  # as a shell says of a program that Ctrl-C ended
    return 0


def _raising(arguments: Sequence[str]) -> list[str]:
    """ARGUMENTS with which a command raises a CommandError instead of printing it with Django's prefix."""
    program, *rest = arguments
    if not rest or rest[0] == "help" or rest[0].startswith("-"):
        return [program, *rest]
    return [program, rest[0], TRACEBACK, *rest[1:]]


if __name__ == "__main__":
    sys.exit(main(sys.argv))
