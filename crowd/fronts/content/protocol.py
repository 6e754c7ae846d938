"""Consistency checks of the measuring protocol of a front, and the order of its runs."""

from collections import Counter
from collections.abc import Collection, Iterator

from msgspec.structs import replace

from wire.front import ADAPTIVE, BEST, DEFAULT, Protocol
from wire.protocol import MOST_RUNS, VERSION

# What every session measures, forwards and back, so that a steady drift cancels in the pairs.
ORDERS = tuple((*names, *reversed(names)) for names in ((DEFAULT, BEST), (DEFAULT, BEST, ADAPTIVE)))
MEMBERS = Protocol.__struct_fields__


def session_protocol(protocol: Protocol, names: Collection[str]) -> Protocol:
    """`protocol` with the order for a front with the points `names`: `adaptive` is measured where it is one.

    An order that an administrator wrote stays.
    """
    return replace(protocol, order=ORDERS[ADAPTIVE in names]) if protocol.order in ORDERS else protocol


def disagreements(protocol: Protocol, configurations: Collection[str]) -> Iterator[str]:
    """Inconsistencies of `protocol`, with itself or with the names of the front's `configurations`."""
    if protocol.version > VERSION:
        yield f"version: {protocol.version} is unknown here: this program measures by version {VERSION}"
    if protocol.first_counted_frame >= protocol.frames:
        yield f"first_counted_frame: {protocol.first_counted_frame} is not below frames ({protocol.frames})"
    counts = Counter(protocol.order)
    if unknown := [name for name in counts if name not in configurations]:
        yield (
            f"order: {unknown[0]!r:.80} is not a configuration of this front: choose from "
            f"{', '.join(configurations)}"
        )
    if DEFAULT not in counts:
        yield f"order: {DEFAULT} is missing: every speedup is measured against it"
    if len(counts) == 1:
        yield f"order: it only names {DEFAULT}: add a configuration to compare with it"
    if len(set(counts.values())) > 1:
        yield f"order: each configuration must appear equally often, not {dict(counts)}"
        return
    each = counts.most_common(1)[0][1]
    if protocol.repeats % each:
        yield f"repeats: order names each configuration {each} times: give {each} or a multiple of it"
    if (runs := protocol.repeats * len(counts)) > MOST_RUNS:
        yield f"repeats: {protocol.repeats} of {len(counts)} names are {runs} runs: give at most {MOST_RUNS}"
