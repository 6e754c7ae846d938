"""What a publication changes for clients, shown before it is confirmed."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from crowd.fronts import intake_policy, selectors
from crowd.fronts.content import plans
from crowd.fronts.content.difference import Difference, difference, warnings
from wire.front import BEST, DEFAULT, Front, Point

# What browsers can measure after a publication, by whether they can before it and after it.
BROWSERS = {
    (True, False): "Phones and other browsers can no longer measure: only the native client can.",
    (False, True): "Phones and other browsers can measure, too, from then on.",
    (False, False): "Phones and other browsers cannot measure it: only the native client can.",
}


@dataclass(frozen=True)
class Preview:
    """The publication of `new` in place of `current`, which is None if no front is published."""

    new: Front
    current: Front | None

    @property
    def difference(self) -> Difference | None:
        return None if self.current is None else difference(self.current, self.new)

    @property
    def consequences(self) -> tuple[str, ...]:
        """What changes for clients, in sentences."""
        return tuple(_consequences(self.current, self.new))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Why clients may get a worse `best`."""
        return () if self.current is None else warnings(self.current, self.new)

    @property
    def token(self) -> str:
        """Changes if one of the fronts changes, so that a confirmation only counts for what was shown."""
        return f"{self.new.slug} {self.new.digest} {self.current.digest if self.current else 'none'}"


def preview(new: Front) -> Preview:
    """A preview of publishing `new` now. Two queries."""
    return Preview(new, selectors.current(new.application))


def lines(shown: Preview) -> list[str]:
    """The preview as lines for a terminal."""
    change = shown.difference
    if change is None:
        first = f"No front of {shown.new.application} is published now: {shown.new.slug} is the first."
        return [first, *shown.consequences]
    text = [f"Clients measure {shown.new.slug} instead of {change.old.slug}.", *shown.consequences]
    words = len(text)
    text += [
        f"  {word}: {', '.join(point.name for point in points)}"
        for word, points in (("gained", change.gained), ("lost", change.lost))
        if points
    ]
    text += [f"  changed: {_change(pair.old, pair.new)}" for pair in change.changed]
    text += [f"  {one.name} is another configuration: {_pairs(one.parameters)}" for one in change.redefined]
    if change.members:
        text.append(f"  {_pairs(change.members)}")
    if change.growth is not None:
        text.append(f"  hypervolume: {change.growth:.3f} times the earlier one")
    if change.caveat:
        text.append(f"  The two were {change.caveat}: their times compare only roughly.")
    if not text[words:]:
        text.append("  Both have the same configurations, predictions and protocol.")
    return text + [f"WARNING: {warning}" for warning in shown.warnings]


def _consequences(current: Front | None, new: Front) -> Iterator[str]:
    ability = current is not None and plans.browsers_measure(current), plans.browsers_measure(new)
    if ability in BROWSERS:
        yield BROWSERS[ability]
    if current is None:
        return
    before, required = (_required_version(front) for front in (current, new))
    if required != before:
        yield f"Native clients must be of version {required} or later."
    for name in (DEFAULT, BEST):
        old, changed = current.point(name), new.point(name)
        if old is not None and changed is not None and old.parameters != changed.parameters:
            yield f"{name} is another configuration: speedups of the two fronts are not mixed."
    if current.sequence["sha256"] != new.sequence["sha256"]:
        yield f"Each client first downloads another sequence: {new.sequence['name']}."
    if _session(current) != _session(new):
        yield f"A session has {_session(new)} instead of {_session(current)}."


def _required_version(front: Front) -> str:
    prepared = front.provenance.get("prepared", {})
    return intake_policy.current().at_least(prepared.get("app_version", "0")).minimum_app_version


def _session(front: Front) -> str:
    runs = front.protocol.repeats * len(set(front.protocol.order))
    return f"{runs} runs of {front.protocol.frames} frames"


def _change(old: Point, new: Point) -> str:
    name = new.name if old.name == new.name else f"{old.name} -> {new.name}"
    return f"{name}, runtime {old.runtime} -> {new.runtime} s, largest error {old.ate_max} -> {new.ate_max} m"


def _pairs(differing: Mapping[str, tuple[Any, Any]]) -> str:
    return ", ".join(f"{name} {before} -> {after}" for name, (before, after) in differing.items())
