"""The difference of two versions of a front: points gained, lost and kept, and their coverage."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from msgspec.structs import asdict

from crowd.fronts.content.coverage import Rectangle, coverage, rectangle
from wire.front import BEST, DEFAULT, Front, Point, predicted_speedup


@dataclass(frozen=True)
class Match:
    """A configuration of both versions, perhaps with another name or other predictions."""

    old: Point
    new: Point

    @property
    def changed(self) -> bool:
        return self.old.name != self.new.name or self.old.predicted != self.new.predicted


@dataclass(frozen=True)
class Redefined:
    """A name that now stands for another configuration; `parameters` differ, before and after."""

    name: str
    old: Point
    new: Point
    parameters: Mapping[str, tuple[Any, Any]]


@dataclass(frozen=True)
class Difference:
    """`new` compared with `old`. Coverages (0 to 1) refer to the common `rectangle`.

    `caveat` says why runtimes or errors cannot be compared; empty if they can.
    """

    old: Front
    new: Front
    gained: tuple[Point, ...]
    lost: tuple[Point, ...]
    kept: tuple[Match, ...]
    redefined: tuple[Redefined, ...]
    members: Mapping[str, tuple[Any, Any]]
    rectangle: Rectangle | None
    old_coverage: float | None
    new_coverage: float | None
    caveat: str

    @property
    def changed(self) -> tuple[Match, ...]:
        """The common configurations whose names or predictions differ."""
        return tuple(pair for pair in self.kept if pair.changed)

    @property
    def growth(self) -> float | None:
        """The ratio of the new to the old coverage; None if one is unknown or the old one is 0."""
        if not self.old_coverage or self.new_coverage is None:
            return None
        return self.new_coverage / self.old_coverage


def difference(old: Front, new: Front) -> Difference:
    """Compare `new` with `old`. Points are the same if all their parameters are."""
    before = {_key(point): point for point in old.points}
    after = {_key(point): point for point in new.points}
    both = rectangle(old, new)
    return Difference(
        old=old,
        new=new,
        gained=tuple(point for key, point in after.items() if key not in before),
        lost=tuple(point for key, point in before.items() if key not in after),
        kept=tuple(Match(before[key], point) for key, point in after.items() if key in before),
        redefined=tuple(_redefined(old, new)),
        members=_members(old, new),
        rectangle=both,
        old_coverage=coverage(old, both),
        new_coverage=coverage(new, both),
        caveat=_caveat(old, new),
    )


def warnings(current: Front, new: Front) -> tuple[str, ...]:
    """Why the `best` of `new` may be worse than that of `current`; empty if it is not.

    Compares the predicted speedup over each front's own default, and the largest error.
    """
    figures = (
        ("speedup over default", _speedup(current), _speedup(new), False, "{:.2f}x"),
        ("largest error", _error(current), _error(new), True, "{:.4f} m"),
    )
    reasons = []
    for figure, before, after, less_is_better, shown in figures:
        if before is None or after is None:
            where = new.slug if after is None else current.slug
            reasons.append(f"The predicted {figure} of best is unknown in {where}: it cannot be compared.")
        elif (after > before) if less_is_better else (after < before):
            reasons.append(
                f"The predicted {figure} of best gets worse: {shown.format(after)} instead of "
                f"{shown.format(before)} in {current.slug}."
            )
    return tuple(reasons)


def _speedup(front: Front) -> float | None:
    default, best = front.point(DEFAULT), front.point(BEST)
    if default is None or best is None:
        return None
    return predicted_speedup(default.predicted, best.predicted)


def _error(front: Front) -> float | None:
    best = front.point(BEST)
    return None if best is None else best.ate_max


def _key(point: Point) -> tuple[tuple[str, Any], ...]:
    return tuple(sorted(point.parameters.items()))


def _redefined(old: Front, new: Front) -> list[Redefined]:
    pairs = [(point, old.point(point.name)) for point in new.points]
    return [
        Redefined(after.name, before, after, _differing(before.parameters, after.parameters))
        for after, before in pairs
        if before is not None and before.parameters != after.parameters
    ]


def _members(old: Front, new: Front) -> dict[str, tuple[Any, Any]]:
    """The sequence and the members of the protocol that differ, before and after."""
    protocols = _differing(asdict(old.protocol), asdict(new.protocol))
    differing = {f"protocol {name}": pair for name, pair in protocols.items()}
    if old.sequence["sha256"] != new.sequence["sha256"]:
        differing["sequence"] = (
            f"{old.sequence['name']} {old.sequence['sha256'][:12]}",
            f"{new.sequence['name']} {new.sequence['sha256'][:12]}",
        )
    return differing


def _differing(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    return {
        name: (before.get(name), after.get(name))
        for name in dict.fromkeys([*before, *after])
        if before.get(name) != after.get(name)
    }


def _caveat(old: Front, new: Front) -> str:
    differing = [
        word
        for word, before, after in (
            ("sequences", old.sequence["sha256"], new.sequence["sha256"]),
            ("devices", old.provenance.get("device"), new.provenance.get("device")),
            ("versions of the software", old.provenance.get("software"), new.provenance.get("software")),
        )
        if before != after
    ]
    return f"measured with different {' and '.join(differing)}" if differing else ""
