"""What this machine tells of itself: small files and small programs, None where it hides or lacks one."""

import shutil
import subprocess
from pathlib import Path

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
    """A file's text without the space around it; None for an empty one too."""
    return (read(path) or "").strip() or None


def number(path: Path) -> float | None:
    """The number that a file holds; None where it holds none."""
    try:
        return float(word(path) or "")
    except ValueError:
        return None


def program(name: str, root: Path = Path("/"), *places: str) -> str | None:
    """Where a program is: on PATH, else at one of PLACES below ROOT."""
    found = shutil.which(name)
    return found or next((str(root / place) for place in places if (root / place).is_file()), None)


def output(path: str | None, *arguments: str) -> str | None:
    """What a program prints; None where it is missing, fails or does not come back in time."""
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
    """VALUE as one printable line of at most LONGEST_TEXT characters, None when nothing is left of it."""
    if value is None:
        return None
    printable = "".join(c if c.isprintable() else " " for c in str(value))
    return " ".join(printable.split())[:LONGEST_TEXT] or None
