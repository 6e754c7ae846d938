"""Rules that build a name from a pattern's groups. The first matching rule wins.

A group matches only numbers, listed words or at most three letters, so that names contain no text of
strangers. `\\d`, `\\w` and `\\b` are ASCII: look-alike letters of other scripts do not match.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass

# The spelling of words in names. Other words are written in capitals.
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
    """A text that matches `pattern` gets `name`, whose {0}, {1}... are the groups of the pattern."""

    pattern: re.Pattern[str]
    name: str

    def apply(self, text: str) -> str:
        """The name for `text`; empty if the pattern does not match."""
        match = self.pattern.search(text)
        if match is None:
            return ""
        return " ".join(self.name.format(*map(_spelled, match.groups())).split())


def compile_rules(rules: Iterable[tuple[str, str]]) -> tuple[Rule, ...]:
    """Compile `rules`, pairs of a case-insensitive pattern and a name."""
    return tuple(Rule(re.compile(pattern, re.IGNORECASE | re.ASCII), name) for pattern, name in rules)


def first_match(rules: Iterable[Rule], text: str) -> str:
    """The name for `text` by the first matching rule; empty if no rule matches."""
    return next((name for rule in rules if (name := rule.apply(text))), "")


def _spelled(group: str | None) -> str:
    if group is None:
        return ""
    return SPELLED.get(group.strip().casefold(), group.strip().upper())
