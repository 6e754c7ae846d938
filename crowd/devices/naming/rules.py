"""The tables of names (`tables/*.toml`), and the rules that build a name from a pattern's groups.

A row is a pattern and a name, whose {0}, {1}... are the groups of the pattern. The first row that matches
decides. A group matches only numbers, listed words or at most three letters, so that names contain no text
of strangers. `\\d`, `\\w` and `\\b` are ASCII: look-alike letters of other scripts do not match.
"""

import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

FLAGS = re.IGNORECASE | re.ASCII


def table(kind: str) -> dict[str, Any]:
    """The table of a kind of things: "processors" is the file processors.toml."""
    return tomllib.loads((Path(__file__).parent / "tables" / f"{kind}.toml").read_text(encoding="utf-8"))


def one_of(patterns: Iterable[str]) -> re.Pattern[str]:
    """A pattern that matches where one of `patterns` does."""
    return re.compile("|".join(patterns), FLAGS)


def numbered(rows: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """The keys and names of `rows`. 'gcn-1..5' stands for five keys, whose names have the number as {0}."""
    for key, name in rows.items():
        if match := re.search(r"(\d+)\.\.(\d+)", key):
            for number in range(int(match[1]), int(match[2]) + 1):
                yield key.replace(match[0], str(number)), name.format(number)
        else:
            yield key, name


class Rules:
    """Rows of a table, in their order."""

    def __init__(self, rows: Mapping[str, str]) -> None:
        self._rows = [(re.compile(pattern, FLAGS), name) for pattern, name in rows.items()]

    def name(self, text: str) -> str:
        """The name for `text` by the first row that matches; empty if none does."""
        for pattern, name in self._rows:
            if match := pattern.search(text):
                return " ".join(name.format(*map(_spelled, match.groups())).split())
        return ""


_words = table("words")
_SPELLED: dict[str, str] = {word.casefold(): word for word in _words["words"]} | _words["spelled"]


def _spelled(group: str | None) -> str:
    text = (group or "").strip()
    return _SPELLED.get(text.casefold(), text.upper())
