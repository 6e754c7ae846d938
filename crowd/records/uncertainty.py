"""The uncertainty of a device model's figure, the only one: pages, the headline, comparisons, predictions and
open data use it.
"""

import math
from dataclasses import dataclass

LEAST_UNITS = 3
# Standard deviations of log ratios between units of one model. Repeats of one device differ by the least: a
# smaller one of few units is chance. Honest installations differ by a tenth, where too few measured.
LEAST_DEVIATION = 0.01
TYPICAL_DEVIATION = math.log(1.1)
# Huber's mean of a few normal values varies like the mean of 0.86 (three) to 0.95 (many) times as many.
EFFICIENCY = 0.9
# The typical deviation counts like so many more units.
TYPICAL_UNITS = 2
# Student's t, two-sided 95 %, of a session's four pairs.
SESSION_QUANTILE = 3.182


@dataclass(frozen=True)
class Estimate:
    """A mean of logarithms with its standard `error` and `degrees` of freedom.

    `assumed`: the error is not measured, so that no interval follows from it.
    """

    log: float
    error: float
    degrees: float
    assumed: bool = False


def figure_estimate(
    log: float,
    deviation: float | None,
    units: int,
    session_low: float | None = None,
    session_high: float | None = None,
) -> Estimate:
    """A figure with its uncertainty, from the columns of its row. `log`: its logarithm.

    n `units` with the standard `deviation` s have the error s / sqrt(EFFICIENCY n) and n - 1 degrees of
    freedom. Fewer than LEAST_UNITS: n times the squared error is the mean of s^2 and TYPICAL_DEVIATION^2,
    weighted by n - 1 and TYPICAL_UNITS. The error is at least that of the only session, `session_low` to
    `session_high`.
    """
    if deviation is not None and units >= LEAST_UNITS:
        return Estimate(log, max(deviation, LEAST_DEVIATION) / math.sqrt(EFFICIENCY * units), units - 1)
    degrees = units - 1 + TYPICAL_UNITS
    squares = (units - 1) * (deviation or 0.0) ** 2 + TYPICAL_UNITS * TYPICAL_DEVIATION**2
    error = math.sqrt(squares / degrees / units)
    if session_low and session_high:
        error = max(error, math.log(session_high / session_low) / (2 * SESSION_QUANTILE))
    return Estimate(log, error, degrees, assumed=True)
