"""The poses of an estimate and a truth that have the same stamps, or the reason why there are too few."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from slam.trajectories.trajectory import TrajectoryError, associate

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.intp]

LEAST_SHARE = 0.1  # of the shorter trajectory: fewer poses match by chance
OTHER_UNITS = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9, "frame numbers": 1 / 30}


def match(estimate: Array, truth: Array, maximal_difference: float) -> tuple[Rows, Rows]:
    """Indices of the poses whose stamps lie within `maximal_difference` seconds, as `associate` pairs them.

    Raises TrajectoryError where all stamps of one are equal, and where fewer than two poses or LEAST_SHARE of
    the shorter trajectory match; it names the unit in which more stamps would match.
    """
    for name, stamps in (("estimate", estimate), ("truth", truth)):
        if len(stamps) > 1 and np.ptp(stamps) == 0:
            raise TrajectoryError(
                f"all {len(stamps)} stamps of the {name} are {stamps[0]:g}: write the second of each pose"
            )
    rows, partners = associate(estimate, truth, maximal_difference)
    shorter = min(len(estimate), len(truth))
    if len(rows) < min(shorter, max(2, LEAST_SHARE * shorter)):
        unit = _other_unit(estimate, truth, maximal_difference)
        remedy = (
            f"the stamps of {unit}: write seconds"
            if unit
            else "give --max-difference, or trajectories of the same recording"
        )
        raise TrajectoryError(
            f"{len(rows)} of {shorter} stamps of the estimate ({estimate[0]} to {estimate[-1]}) and of the "
            f"truth ({truth[0]} to {truth[-1]}) lie within {maximal_difference} s: {remedy}"
        )
    return rows, partners


def _other_unit(estimate: Array, truth: Array, maximal_difference: float) -> str | None:
    """Whose stamps match in which other unit, if more than LEAST_SHARE would."""
    for unit, seconds in OTHER_UNITS.items():
        for name, first, second in (("estimate", estimate, truth), ("truth", truth, estimate)):
            scaled = first * seconds
            if not 0.1 * np.ptp(second) < np.ptp(scaled) < 10 * np.ptp(second):
                continue  # another recording; all stamps of it would lie close together
            rows, _ = associate(scaled, second, maximal_difference)
            if len(rows) > LEAST_SHARE * min(len(first), len(second)):
                return f"the {name} are {unit}"
    return None
