"""The crowd under filters: its bars, its figure in one line and in parts, and where a device stands in it.

Pure functions of rows.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

from crowd.fronts.selectors import BEST
from crowd.results.figures import statistics
from crowd.results.reading.filters import ALL, SpeedupFilters
from crowd.results.reading.rows import Headline, Place, Share, Speedup

PARTS = ("vendor", "soc", "os")


@dataclass(frozen=True)
class Speedups:
    """What the filters leave, fastest first, and the front they mean (None: no front is published)."""

    filters: SpeedupFilters
    front: str | None
    rows: tuple[Speedup, ...]

    @cached_property
    def headline(self) -> Headline:
        """The figure of the configuration that the filters name."""
        return headline(self.rows, self.filters.configuration)

    @cached_property
    def parts(self) -> Mapping[str, tuple[Share, ...]]:
        """The breakdown of that figure by each of PARTS."""
        return {by: breakdown(self.rows, by, self.filters.configuration) for by in PARTS}


def headline(rows: Iterable[Speedup], configuration: str = BEST) -> Headline:
    """The crowd's figure over device models; a model measured on several processors counts once.

    The models of which no valid figure exists count only where there is none of any model.
    """
    counted = _counted(rows, configuration)
    models = list(_by_model(counted).values())
    crowd = statistics.crowd_speedup([(math.log(speedup), 0.0) for speedup in models])
    return Headline(
        devices=len(models),
        sessions=sum(row.sessions for row in counted),
        geometric_mean=crowd.value if crowd else None,
        low=crowd.low if crowd else None,
        high=crowd.high if crowd else None,
        min=min(models, default=None),
        max=max(models, default=None),
        suspect=bool(counted) and counted[0].suspect,
    )


def breakdown(rows: Iterable[Speedup], by: str, configuration: str = BEST) -> tuple[Share, ...]:
    """The headline of each group of ROWS, most devices first; BY is "vendor" (whose chip computed), "soc",
    "gpu" or "os". A model measured on several vendors' chips counts with each; a figure that the headline of
    all ROWS leaves out counts with none.
    """
    groups: dict[str, list[Speedup]] = defaultdict(list)
    for row in _counted(rows, configuration):
        groups[row.vendor if by == "vendor" else getattr(row.device, by)].append(row)
    shares = (Share(group, headline(members, configuration)) for group, members in groups.items())
    return tuple(sorted(shares, key=lambda share: (-share.figure.devices, share.group)))


def place(rows: Iterable[Speedup], slug: str, configuration: str = BEST) -> Place | None:
    """Where the device SLUG stands in ROWS; None where no figure of it counts in their headline."""
    counted = _counted(rows, configuration)
    devices = {row.device.slug: row.device for row in counted}
    models = _by_model(counted)
    if slug not in models:
        return None
    own = models[slug]
    ordered = sorted(models, key=lambda name: (-models[name], name))
    slower = sum(speedup < own for speedup in models.values())
    return Place(
        device=devices[slug],
        speedup=own,
        rank=1 + sum(speedup > own for speedup in models.values()),
        slower=slower / (len(models) - 1) if len(models) > 1 else None,
        models=tuple((devices[name], models[name]) for name in ordered),
    )


def _counted(rows: Iterable[Speedup], configuration: str) -> list[Speedup]:
    """Those of ROWS that a headline is made of."""
    name = BEST if configuration == ALL else configuration
    shown = [row for row in rows if row.configuration == name]
    return [row for row in shown if not row.suspect] or shown


def _by_model(rows: Iterable[Speedup]) -> dict[str, float]:
    """Each model's speedup, the geometric mean over its processors, by its slug."""
    found: dict[str, list[float]] = defaultdict(list)
    for row in rows:
        found[row.device.slug].append(row.speedup)
    return {slug: statistics.geometric_mean(values) for slug, values in found.items()}
