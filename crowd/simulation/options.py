"""The options of a command that makes a demo server."""

from argparse import ArgumentParser

from django.core.management.base import CommandError

DEVICES = 83


def add_arguments(parser: ArgumentParser) -> None:
    """The options of a command that makes a demo server."""
    parser.add_argument("--demo", action="store_true", help="a server of simulated data, in an empty folder")
    parser.add_argument("--devices", type=int, default=DEVICES, help=f"with --demo: how many ({DEVICES})")
    parser.add_argument("--seed", type=int, default=0, help="with --demo: of the random numbers (0)")


def check_arguments(devices: int, seed: int) -> None:
    """Raises CommandError for numbers that make no demo."""
    if devices < 1 or seed < 0:
        raise CommandError("--devices must be 1 or more, --seed 0 or more")
