"""A draft with what its preparation measured: references, times, and only the points that are different."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from django.utils import timezone
from msgspec import to_builtins

from crowd.fronts.content import front_file
from crowd.fronts.content.generalisation import Results, objections
from crowd.fronts.content.protocol import session_protocol
from groundwork import __version__
from pareto.fronts.front import knee
from slam.references import bands, times
from slam.references.times import Relative, Timed
from wire.front import ADAPTIVE, BEST, DEFAULT, Front, Point

ACCURATE, KNEE = "accurate", "knee"
# Names that say what a point is among the others. All other names are labels, which stay.
BY_ROLE = re.compile(rf"{BEST}|{ADAPTIVE}|{ACCURATE}|{KNEE}|front-\d+")


class NotPreparableError(ValueError):
    """The draft cannot become a front that clients measure. The message says why and what to do."""


@dataclass(frozen=True)
class Measured:
    """What a preparation has measured, by the names of the points.

    `references`: {trajectory, band, largest_deviation, variants, skipped, program}. `timed`: all runs, in the
    order in which they ran. `failed`: the reasons of failures. `device` timed the points; `software` is the
    version that did.
    """

    references: Mapping[str, Mapping[str, Any]]
    timed: Sequence[Timed]
    failed: Mapping[str, str] = field(default_factory=dict)
    device: Mapping[str, Any] = field(default_factory=dict)
    software: str = ""

    @cached_property
    def runs(self) -> list[Timed]:
        """The runs that other programs did not disturb."""
        return times.undisturbed(self.timed)

    def skipping(self) -> set[str]:
        """The points that leave out frames."""
        return {name for name, one in self.references.items() if one.get("skipped") is not None}

    def without_reference(self, front: Front) -> dict[str, str]:
        """The points of `front` that cannot be compared between devices, each with the reason."""
        reasons = {}
        for point in (*front.points, *front.probes):
            reference = self.references.get(point.name)
            if reference is None:
                reasons[point.name] = self.failed.get(point.name, "it was not measured")
            elif reference["band"] > bands.WIDEST_BAND:
                reasons[point.name] = (
                    f"devices differ by {1e3 * reference['largest_deviation']:.1f} mm, so its band would "
                    f"be {1e2 * reference['band']:.1f} cm, more than {1e2 * bands.WIDEST_BAND:g} cm"
                )
        return reasons


def check_references(front: Front, measured: Measured) -> None:
    """Raise NotPreparableError if default or best lacks a reference, or if only one variant ran."""
    left = measured.without_reference(front)
    for name in (DEFAULT, BEST):
        if name in left:
            raise NotPreparableError(f"{name}: {left[name]}: choose another point for it in a new draft")
    ran = measured.references[DEFAULT]["variants"]
    # WebAssembly gives the same to the bit with any number of threads.
    if len({name.partition(", threads: ")[0] for name in ran}) < bands.LEAST_VARIANTS:
        raise NotPreparableError(
            f"only {', '.join(ran)} ran, so nothing is known of other devices: install an OpenCL driver "
            "(on Debian pocl-opencl-icd) and the extra wasm"
        )


def document(front: Front, measured: Measured) -> dict[str, Any]:
    """`front`, a draft, as a front file that clients can measure.

    Points that another beats or equals in error and time are left out; the default and labelled points stay.
    The others are named again by what they are. Raises NotPreparableError if no point may be called best.
    """
    relative_times = times.relative(measured.runs)
    left = measured.without_reference(front)
    left |= {name: reason for name, reason in measured.failed.items() if name not in left}
    points = {point.name: point for point in front.points if point.name not in left}
    if DEFAULT in left or DEFAULT not in relative_times:
        raise NotPreparableError(f"{DEFAULT}: {left.get(DEFAULT, 'it was not timed')}")
    errors = {name: float("inf") if p.ate_max is None else p.ate_max for name, p in points.items()}
    labels = [name for name in points if not BY_ROLE.fullmatch(name)]
    beaten = times.beaten(relative_times, errors, labels)
    points = {name: point for name, point in points.items() if name not in beaten}
    names = _names(front, points, relative_times, measured.skipping())
    for name, winner in beaten.items():
        before = "" if names[winner] == winner else f" ({winner} in the draft)"
        left[name] = f"{names[winner]}{before} is at least as fast and as accurate"
    apart = times.undecided(relative_times, points)

    def row(point: Point, name: str, undecided: Sequence[str] = ()) -> dict[str, Any]:
        reference = measured.references[point.name]
        earlier: dict[str, Any] = to_builtins(point)
        return earlier | {
            "name": name,
            "predicted": earlier["predicted"] | {"on_sequence": relative_times[point.name].summary()},
            "not_told_apart": [names[other] for other in undecided],
            **{member: reference.get(member) for member in ("band", "trajectory", "skipped", "program")},
        }

    probes = [row(probe, probe.name) for probe in front.probes if probe.name not in left]
    renamed = {old: new for old, new in names.items() if old != new}
    return front_file.document(front.content) | {
        "protocol": to_builtins(session_protocol(front.protocol, names.values())),
        "configurations": [row(points[old], new, apart.get(old, ())) for old, new in names.items()],
        "probes": probes,
        "provenance": front.provenance | {"prepared": _provenance(measured, left, renamed)},
    }


def _names(
    front: Front,
    points: Mapping[str, Point],
    relative_times: Mapping[str, Relative],
    skipping: Collection[str],
) -> dict[str, str]:
    """The new name of each of `points`, in published order: default, best, adaptive, accurate, knee, labels,
    the rest.

    `best`: the fastest point that is faster than the default and has no objection, labelled ones and those in
    `skipping` aside. `adaptive`: the fastest such point of `skipping`, if there is one.
    """
    ratio = {name: relative_times[name].summary()["runtime_ratio"] for name in points}
    unlabelled = sorted((name for name in points if BY_ROLE.fullmatch(name)), key=ratio.__getitem__)
    default = points[DEFAULT]
    reasons = {name: _objections(points[name], default, front) for name in unlabelled}
    possible = [
        name
        for name in unlabelled
        if not reasons[name] and times.order(relative_times[name], relative_times[DEFAULT]) == "faster"
    ]
    best = next((name for name in possible if name not in skipping), None)
    if best is None:
        why = "; ".join(reason for name in unlabelled for reason in reasons[name][:1])
        raise NotPreparableError(
            f"no point is {BEST}: none is surely faster than the default and holds on every sequence"
            + (f" ({why})" if why else "")
        )
    names = {DEFAULT: DEFAULT, best: BEST}
    if (adaptive := next((name for name in possible if name in skipping), None)) is not None:
        names[adaptive] = ADAPTIVE
    table = np.array([[points[name].ate_max, ratio[name]] for name in unlabelled], dtype=float)
    accurate = unlabelled[int(np.argmin(table[:, 0]))]
    for name, role in ((accurate, ACCURATE), (unlabelled[knee(table)], KNEE)):
        names.setdefault(name, role)
    names |= {name: name for name in points if name not in names and not BY_ROLE.fullmatch(name)}
    others = [name for name in unlabelled if name not in names]
    return names | {name: f"front-{number:02}" for number, name in enumerate(others, start=1)}


def _objections(point: Point, default: Point, front: Front) -> list[str]:
    """Why `point` cannot be best of `front`, as the check of a front says it."""
    results, beside = (Results(p.learned_on, p.held_out) for p in (point, default))
    limit = front.protocol.max_ate
    reasons = [f"{point.name}: {reason}" for reason in objections(results, beside, limit)]
    if point.ate_max is None or not point.ate_max < limit:
        reasons.append(f"{point.name}: its error is not below {1e2 * limit:g} cm")
    return reasons


def _provenance(measured: Measured, left: Mapping[str, str], renamed: Mapping[str, str]) -> dict[str, Any]:
    return {
        "date": timezone.now().date().isoformat(),
        "device": measured.device.get("name", ""),
        "driver": measured.device.get("driver", ""),
        "software": measured.software,
        "app_version": __version__,
        "variants": list(measured.references[DEFAULT]["variants"]),
        "rounds": 1 + max(run.round for run in measured.runs),
        "disturbed_runs": len(measured.timed) - len(measured.runs),
        "left_out": dict(left),
        "renamed": dict(renamed),
    }
