"""Why a configuration failed here, in a line that everybody may read."""

from contextlib import suppress
from pathlib import Path

from slam import disclosure

LONGEST = 300


def of(error: Exception) -> str:
    """What ERROR says, as `public` has it."""
    return public(f"{type(error).__name__}: {error}")


def public(text: str) -> str:
    """TEXT in one line, without folders, of which one often is the user's name."""
    with suppress(RuntimeError):  # nobody knows where the user's folder is
        home = str(Path.home())
        # The text of an OSError quotes its path by repr(), which doubles the separators of Windows.
        text = text.replace(repr(home)[1:-1], "~").replace(home, "~")
    printable = "".join(
        character if character.isprintable() else " " for character in disclosure.public(text)
    )
    return " ".join(printable.split())[:LONGEST]
