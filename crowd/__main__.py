"""Django's command line for this project: serve, migrate, front, exploration, backup and the rest."""

import os
import sys
from collections.abc import Sequence


def main(arguments: Sequence[str]) -> int:
    """Carry out the command in ARGUMENTS, the name of the program first; return its exit code."""
    os.environ.setdefault("DJANGO_SETTINGS_MODULE", "crowd.settings")
    from crowd.operations.environment import SettingError

    try:
        import crowd.settings  # noqa: F401 - Django would hide the reason
    except SettingError as error:
        sys.stderr.write(f"frontrunner: {error}\n")
        return 1
    from django.core.management import execute_from_command_line

    try:
        execute_from_command_line(list(arguments))
    except KeyboardInterrupt:
        return 130  # as a shell says of a program that Ctrl-C ended
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv))
