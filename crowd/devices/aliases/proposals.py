"""Proposals that two models of one maker are one device under two names. An administrator decides.

Two names are proposed as one if they have the same spelling, if one is the market name or Android's device
name of the other, or if they differ only in the letters of a region and have the same chip. Models with
different chips are never proposed: they run at different speeds, whatever they are sold as.
"""

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from crowd.devices.naming.names import folded

SPELLING, MARKET_NAME, DEVICE_NAME, REGION = (
    "the same in spelling",
    "the market name of the other",
    "the device name of the other",
    "another region's letters, the same chip",
)
# If more names of a maker than this share a token, the rule does not separate its devices.
MOST_ALIKE = 12
# The letters after the number of a code: region, carrier, number of SIM cards. The first match wins.
REGION_LETTERS = (
    re.compile(r"^(sm-[a-z]\d{3,4})\w{0,3}(?:/ds)?$"),
    re.compile(r"^([a-z]{3})-[a-z]{1,2}\d{2}[a-z]?$"),
    re.compile(r"^((?:[a-z]{1,3}-?)?[a-z]?\d{3,5})[a-z]{1,4}(?:/ds)?$"),
    re.compile(r"^((?:[a-z]{1,3}-?)?[a-z]?\d{3,5})$"),
)


@dataclass(frozen=True)
class Candidate:
    """A model as the rules compare it; `devices` are the Build.DEVICE names of its descriptions."""

    key: int
    manufacturer: str
    name: str
    market_name: str = ""
    soc: str = ""
    cpu: str = ""
    handheld: bool = False
    devices: frozenset[str] = field(default=frozenset())


@dataclass(frozen=True)
class Proposal:
    """`alias` may be another name of `model`, as primary keys."""

    alias: int
    model: int
    reason: str


def propose(candidates: Iterable[Candidate]) -> list[Proposal]:
    """Proposals among `candidates`, each pair once with its strongest reason."""
    by_token: dict[tuple[str, str, str], list[Candidate]] = defaultdict(list)
    for candidate in candidates:
        if candidate.manufacturer:
            for reason, token in dict.fromkeys(tokens(candidate)):
                by_token[(reason, candidate.manufacturer.casefold(), token)].append(candidate)
    proposals: dict[frozenset[int], Proposal] = {}
    for strongest in (SPELLING, MARKET_NAME, DEVICE_NAME, REGION):
        for (reason, _, _), alike in by_token.items():
            if reason != strongest or not 2 <= len(alike) <= MOST_ALIKE:
                continue
            model = min(alike, key=_preference)
            for alias in alike:
                pair = frozenset({alias.key, model.key})
                if alias is not model and pair not in proposals and _may_be_one(alias, model, reason):
                    proposals[pair] = Proposal(alias.key, model.key, reason)
    return list(proposals.values())


def tokens(one: Candidate) -> Iterator[tuple[str, str]]:
    """The tokens by which rules find other names of `one`, each with its rule.

    None if its name is only that of its processor: two products may have the same processor.
    """
    if one.cpu and folded(one.name) == folded(one.cpu):
        return
    spelled = {folded(one.name), folded(one.name).removeprefix(folded(one.manufacturer))} - {""}
    for name in spelled:
        yield SPELLING, name
        yield MARKET_NAME, name
        yield DEVICE_NAME, name
    if one.market_name:
        yield MARKET_NAME, folded(one.market_name)
    for device in one.devices:
        yield DEVICE_NAME, folded(device)
    if one.handheld and one.soc:
        code = one.name.casefold()
        stem = next((match[1] for rule in REGION_LETTERS if (match := rule.match(code))), None)
        if stem is not None:
            yield REGION, stem


def _may_be_one(a: Candidate, b: Candidate, reason: str) -> bool:
    if a.handheld != b.handheld or (a.cpu and b.cpu and not a.handheld and folded(a.cpu) != folded(b.cpu)):
        return False
    if a.soc and b.soc and a.soc != b.soc:
        return False
    if reason in (MARKET_NAME, DEVICE_NAME):
        # Two codes with one market name are one model only if a code or a device name agrees too.
        return (
            _names(a) & _known_as(b) != set()
            or _names(b) & _known_as(a) != set()
            or bool(a.devices & b.devices)
        )
    return True


def _names(one: Candidate) -> set[str]:
    return {folded(one.name)}


def _known_as(one: Candidate) -> set[str]:
    return {folded(one.market_name), *(folded(device) for device in one.devices)} - {""}


def _preference(one: Candidate) -> tuple[bool, bool, int]:
    """The sort key of the name to keep: in the catalogue, then with a known chip, then oldest."""
    return (not one.market_name, not one.soc, one.key)
