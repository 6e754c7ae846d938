"""Rules that construct a name from what they match in a text. The first rule that matches wins.

A group of a pattern matches numbers, listed words or at most three letters, so that no other text of a
stranger gets into a name. `\\d`, `\\w` and `\\b` are ASCII: look-alikes from other scripts match nothing.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass

# How words are written in names. What is not listed is written in capitals.
WORDS = (
    "v2", "v3", "v4", "v5", "v6", "4s", "6s", "7s", "8s", "Gen 1", "Gen 2", "Gen 3", "Gen 4", "Gen 5",
    "Bronze", "Silver", "Gold", "Platinum", "Pro", "Plus", "Max", "Max+", "Ultra", "Premium", "Elite",
    "Extreme", "Go", "Duo", "Quad", "Solo", "Dual", "Naples", "Rome", "Milan", "Genoa", "Turin",
    "Bionic", "Fusion", "Mini", "Nano", "Ti", "Super", "Max-Q", "Laptop GPU", "PCIe", "Black", "Kepler",
    "Maxwell", "Pascal", "Volta", "Turing", "Ampere", "Ada Generation", "Lovelace", "Hopper", "Blackwell",
    "Workstation Edition", "Server Edition", "Max-Q Workstation Edition", "Generation", "Orin", "Xavier",
    "Thor", "Vega", "Renoir", "Cezanne", "Lucienne", "Barcelo", "Rembrandt", "Phoenix", "Raphael",
    "Mendocino", "VanGogh", "Picasso", "Raven", "Ellesmere", "Baffin", "Tahiti", "Pitcairn", "Bonaire",
    "Oland", "Hawaii", "Fiji", "Tonga", "Lexa", "Fury", "Fury X", "Xe", "Flex", "NanoUltra", "NanoLite",
)  # fmt: skip
SPELLED = {word.casefold(): word for word in WORDS} | {
    "ada": "Ada Generation", "max-q design": "Max-Q", "mobile": "Laptop GPU", "super": "SUPER",
    "90a": "90a", "90c": "90c",
}  # fmt: skip


@dataclass(frozen=True)
class Rule:
    """What `pattern` finds is called `name`, whose {0}, {1}... are the pattern's groups."""

    pattern: re.Pattern[str]
    name: str

    def apply(self, text: str) -> str:
        """The name of what TEXT contains; empty where the pattern does not match."""
        found = self.pattern.search(text)
        if found is None:
            return ""
        return " ".join(self.name.format(*map(_spelled, found.groups())).split())


def compiled(rules: Iterable[tuple[str, str]]) -> tuple[Rule, ...]:
    """RULES as pairs of a pattern, for any case of letters, and a name."""
    return tuple(Rule(re.compile(pattern, re.IGNORECASE | re.ASCII), name) for pattern, name in rules)


def first_name(rules: Iterable[Rule], text: str) -> str:
    """The name that the first matching one of RULES gives TEXT; empty where none matches."""
    return next((name for rule in rules if (name := rule.apply(text))), "")


def _spelled(group: str | None) -> str:
    if group is None:
        return ""
    return SPELLED.get(group.strip().casefold(), group.strip().upper())
