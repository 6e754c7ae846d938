"""Short and distinct names of devices for an axis."""

import re
from collections import Counter
from collections.abc import Sequence

from crowd.records.device import Device

ELLIPSIS = "\N{HORIZONTAL ELLIPSIS}"
# Less important parts of a name: in brackets, or after a comma.
LEAST = re.compile(r"\s*\([^)]*\)|,.*")


def brief(name: str) -> str:
    """`name` without parts in brackets or after a comma, unless nothing is left."""
    return LEAST.sub("", name).strip() or name


def short_names(devices: Sequence[Device], length: int) -> list[str]:
    """Distinct names of at most `length` characters (eight or more) for `devices`, in order.

    The maker, parts in brackets and parts after a comma are dropped, unless two names become equal. Long
    names are cut in the middle; equal ones are numbered.
    """
    full = [device.name or device.title for device in devices]
    plain = [brief(name) for name in full]
    taken = Counter(plain)
    chosen = [short if taken[short] == 1 else name for short, name in zip(plain, full, strict=True)]
    cut = [_cut(name, length) for name in chosen]
    counts, seen = Counter(cut), Counter[str]()
    shortened = []
    for name in cut:
        seen[name] += 1
        number = f" {seen[name]}"
        shortened.append(f"{name[: length - len(number)]}{number}" if counts[name] > 1 else name)
    return shortened


def _cut(name: str, length: int) -> str:
    if len(name) <= length:
        return name
    tail = (length - 1) // 3
    return f"{name[: length - 1 - tail].rstrip()}{ELLIPSIS}{name[-tail:].lstrip()}"
