"""The rules that decide whether a measurement counts, for the server, its pages and its documentation.

A run and a session's summary have a state. If a rule applies, they have its code, too. If several apply, the
first in this order sets the state. An exception is MODERATED: the administrator's decision
replaces all others.
"""

from dataclasses import dataclass
from enum import StrEnum

from crowd.results.models import State
from crowd.results.validity import measures, plausibility
from wire import session_statistics
from wire.protocol import SHORTEST_FRAME_US, SKIPPED_TOLERANCE, STAGE_TOLERANCE, VALID_BELOW


class Scope(StrEnum):
    """What a rule applies to."""

    DECISION = "decision of an administrator"
    RUN = "run"
    SESSION = "session"
    MODEL = "device model"


@dataclass(frozen=True)
class Rule:
    """A rule: the state it sets, its threshold if it has one, and a sentence for readers."""

    code: str
    state: State
    level: Scope
    threshold: float | None
    words: str


FAILED = Rule("failed", State.INVALID, Scope.RUN, None, "the run did not finish")
FRAME_COUNT = Rule(
    "frame_count",
    State.INVALID,
    Scope.RUN,
    None,
    "its number of frames is not the one that the protocol asks for",
)
ATE_MISSING = Rule(
    "ate_missing",
    State.INVALID,
    Scope.RUN,
    None,
    "the client reported no trajectory error, so nothing shows that tracking held",
)
ATE_ABOVE_LIMIT = Rule(
    "ate_above_limit",
    State.INVALID,
    Scope.RUN,
    VALID_BELOW,
    "the largest trajectory error reached the limit: fast and lost is not faster",
)
DEVIATION_ABOVE_BAND = Rule(
    "deviation_above_band",
    State.INVALID,
    Scope.RUN,
    None,
    "its trajectory leaves the band around the configuration's reference: the device computes something else",
)
IMPLAUSIBLE_TIME = Rule(
    "implausible_time",
    State.INVALID,
    Scope.RUN,
    SHORTEST_FRAME_US,
    "its mean time per computed frame is shorter than any device needs: the clock did not run as it should",
)
MODERATED = Rule(
    "moderated", State.QUARANTINED, Scope.DECISION, None, "an administrator removed it from the figures"
)
IDENTICAL_SERIES = Rule(
    "identical_series",
    State.QUARANTINED,
    Scope.RUN,
    measures.LEAST_DISTINCT_TIMES,
    "its frames took exactly as long, to the microsecond, as those that another installation sent before",
)
NO_PAIR = Rule(
    "no_pair",
    State.INVALID,
    Scope.SESSION,
    None,
    "no repeat of the configuration has a repeat of the default to be compared with",
)
RELEASED = Rule(
    "released", State.VALID, Scope.DECISION, None, "an administrator reviewed it and lets it count"
)
EMULATOR = Rule(
    "emulator",
    State.SUSPECT,
    Scope.SESSION,
    None,
    "its device describes itself as an emulator, whose times are those of another machine",
)
INCOMPLETE_PAIRS = Rule(
    "incomplete_pairs",
    State.SUSPECT,
    Scope.SESSION,
    None,
    "a repeat of the configuration or of the default is missing or does not count: a drift would not cancel",
)
UNBALANCED_ORDER = Rule(
    "unbalanced_order",
    State.SUSPECT,
    Scope.SESSION,
    None,
    "on average it ran earlier or later than the default, or two runs claim one place: a drift would not "
    "cancel",
)
CONTENDED = Rule(
    "contended",
    State.SUSPECT,
    Scope.SESSION,
    session_statistics.MOST_WAITED,
    "other programs took the processor while it measured",
)
SPEEDUP_CHANGED = Rule(
    "speedup_changed",
    State.SUSPECT,
    Scope.SESSION,
    session_statistics.LEVEL,
    "its speedup differs between the first and the second half of its pairs, by more than chance",
)
SKIPPED_SHARE = Rule(
    "skipped_share",
    State.SUSPECT,
    Scope.RUN,
    SKIPPED_TOLERANCE,
    "it left out more or fewer frames than the reference does, so its time is that of other work",
)
SKIPPED_TIMES = Rule(
    "skipped_times",
    State.SUSPECT,
    Scope.RUN,
    None,
    "the frames that it left out took longer than those that it computed",
)
STAGES_EXCEED_FRAMES = Rule(
    "stages_exceed_frames",
    State.SUSPECT,
    Scope.RUN,
    STAGE_TOLERANCE,
    "its stages take longer together than the computation they are part of",
)
IMPLAUSIBLE_SPEEDUP = Rule(
    "implausible_speedup",
    State.SUSPECT,
    Scope.SESSION,
    plausibility.REACH_RATIO,
    "its speedup is far from the prediction and from other devices, and no session of another network agrees",
)
IMPOSSIBLE_SPEEDUP = Rule(
    "impossible_speedup",
    State.SUSPECT,
    Scope.SESSION,
    None,
    "its speedup is beyond what the work of its configuration allows, even if others agree",
)
OUTLIER = Rule(
    "outlier",
    State.QUARANTINED,
    Scope.MODEL,
    measures.OUTLIER_DEVIATIONS,
    "it is far from what other networks measured on its device model, and none of them agrees yet",
)

RULES: dict[str, Rule] = {
    rule.code: rule
    for rule in (
        FAILED, FRAME_COUNT, ATE_MISSING, ATE_ABOVE_LIMIT, DEVIATION_ABOVE_BAND, IMPLAUSIBLE_TIME, MODERATED,
        IDENTICAL_SERIES, NO_PAIR, RELEASED, EMULATOR, INCOMPLETE_PAIRS, UNBALANCED_ORDER, CONTENDED,
        SPEEDUP_CHANGED, SKIPPED_SHARE, SKIPPED_TIMES, STAGES_EXCEED_FRAMES, IMPOSSIBLE_SPEEDUP,
        IMPLAUSIBLE_SPEEDUP, OUTLIER,
    )
}  # fmt: skip
