#!/usr/bin/env python3
"""Django's command line for this project: serve, migrate, publish_front, first_admin and the rest."""

import os
import sys


def main() -> None:
    os.environ.setdefault("DJANGO_SETTINGS_MODULE", "crowd.settings")
    from crowd.environment import SettingError

    try:
        import crowd.settings  # noqa: F401 - Django would hide the reason
    except SettingError as error:
        sys.exit(f"manage.py: {error}")
    from django.core.management import execute_from_command_line

    execute_from_command_line(sys.argv)


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.exit(130)  # as a shell says of a program that Ctrl-C ended
