"""The reason why a configuration failed, as one public line."""

from contextlib import suppress
from pathlib import Path

from slam.public_text import one_line, without_folders

LONGEST = 300


def describe(error: Exception) -> str:
    """`error` with its type, as `public_line` has it."""
    return public_line(f"{type(error).__name__}: {error}")


def public_line(text: str) -> str:
    """`text` in one line, without folders, of which one often is the user's name."""
    with suppress(RuntimeError):  # the system does not know the user's folder
        home = str(Path.home())
        # The text of an OSError quotes its path by repr(), which doubles the separators of Windows.
        text = text.replace(repr(home)[1:-1], "~").replace(home, "~")
    return one_line(without_folders(text), LONGEST)
