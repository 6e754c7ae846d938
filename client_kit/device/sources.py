"""Sources of system information: small files and programs; None where missing or hidden."""

import shutil
import subprocess
from pathlib import Path

from slam.public_text import one_line

LARGEST_FILE = 1_000_000
LONGEST_TEXT = 200
PATIENCE_SECONDS = 5.0


def read(path: Path) -> str | None:
    """A small file's text; None where it is missing or, as on many phones, hidden."""
    try:
        with path.open("rb") as file:
            return file.read(LARGEST_FILE).decode("utf-8", "replace")
    except OSError:
        return None


def word(path: Path) -> str | None:
    """A file's text without surrounding space; None if empty."""
    return (read(path) or "").strip() or None


def number(path: Path) -> float | None:
    """The number in a file, or None."""
    try:
        return float(word(path) or "")
    except ValueError:
        return None


def program(name: str, root: Path = Path("/"), *places: str) -> str | None:
    """The path of a program: on PATH, else at one of `places` below `root`."""
    path = shutil.which(name)
    return path or next((str(root / place) for place in places if (root / place).is_file()), None)


def output(path: str | None, *arguments: str) -> str | None:
    """The output of a program; None where it is missing, fails or takes too long."""
    if path is None:
        return None
    try:
        done = subprocess.run(
            [path, *arguments],
            capture_output=True,
            timeout=PATIENCE_SECONDS,
            check=True,
            stdin=subprocess.DEVNULL,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.decode("utf-8", "replace")


def line(value: object) -> str | None:
    """`value` as one printable line of at most LONGEST_TEXT characters, or None if empty."""
    return None if value is None else one_line(str(value), LONGEST_TEXT) or None
