"""Short and distinct names of devices for charts."""

import re
from collections import Counter, defaultdict
from collections.abc import Sequence

from crowd.records.device import Device

ELLIPSIS = "\N{HORIZONTAL ELLIPSIS}"
# Less important parts of a name: in brackets, or after a comma.
LEAST = re.compile(r"\s*\([^)]*\)|,.*")
# What tells two models apart, such as the letters of masked ones.
LAST = re.compile(r" \(([^)]*)\)$")
# What follows the chip in the name of a device that is known by it.
FORM = re.compile(r" device$")


def brief(name: str) -> str:
    """`name` without parts in brackets or after a comma, unless nothing is left."""
    return LEAST.sub("", name).strip() or name


def short_names(devices: Sequence[Device], length: int) -> list[str]:
    """Names of at most `length` characters (eight or more) for `devices`, in order, one for each device.

    A name is the title that tables show, without parts in brackets and after a comma. Where two become equal
    they keep their last part in brackets, or else the whole title. A longer one loses brackets, the word
    "device", then its maker, then its middle. Equal ones are numbered; their numbers are never cut.
    """
    titles: dict[str, set[str]] = defaultdict(set)
    for device in devices:
        titles[brief(device.title)].add(device.title)

    def fitted(device: Device, room: int) -> str:
        name, last = brief(device.title), ""
        if len(titles[name]) > 1:
            found = LAST.search(device.title)
            name, last = (name, found[0]) if found else (device.title, "")
        if len(name + last) > room:
            last = last.replace("(", "").replace(")", "")
        room -= len(last)
        if len(name) > room:
            name = FORM.sub("", name)
        if len(name) > room:
            name = name.removeprefix(device.manufacturer).strip() or name
        return _cut(name, room) + last

    names = {device.slug: fitted(device, length) for device in devices}
    counts, seen = Counter(names.values()), Counter[str]()
    digits = len(f" {max(counts.values(), default=0)}")
    twins = {device.slug: device for device in devices if counts[names[device.slug]] > 1}
    for slug, device in twins.items():
        name = fitted(device, length - digits)
        seen[name] += 1
        names[slug] = f"{name} {seen[name]}"
    return [names[device.slug] for device in devices]


def _cut(name: str, length: int) -> str:
    if len(name) <= length:
        return name
    tail = (length - 1) // 3
    return f"{name[: length - 1 - tail].rstrip()}{ELLIPSIS}{name[len(name) - tail :].lstrip()}"
