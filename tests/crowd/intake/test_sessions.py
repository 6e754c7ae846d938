"""From judged runs to the state and the reason of a session. No database in here."""

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any
from uuid import UUID

import numpy as np
import pytest

from crowd.results.intake import packing
from crowd.results.models import SessionSummary, State
from crowd.results.validity import rules
from crowd.results.validity.runs import Front, StoredRun
from crowd.results.validity.sessions import SessionInput, summarise
from wire.front import Protocol
from wire.protocol import VERSION

FRAMES = 20
DEFAULT, BEST, KNEE = 1, 2, 3
PROTOCOL = Protocol(VERSION, 10, FRAMES, 10, ("default", "best"), repeats=2, rest_seconds=0)
FRONT = Front(1, PROTOCOL, {DEFAULT, BEST, KNEE}, DEFAULT)
ABBA = [DEFAULT, BEST, BEST, DEFAULT]
TIMES = {DEFAULT: 80_000, BEST: 40_000, KNEE: 20_000}
STARTED = datetime(2026, 11, 20, 10, 17, tzinfo=UTC)


def runs(order: Sequence[int], *, slower: float = 1.0, **changes: Any) -> list[StoredRun]:
    """The runs of a session in `order`, each `slower` times the one before, by repeat as they are judged."""
    stored, seen = [], dict.fromkeys(TIMES, 0)
    for number, configuration in enumerate(order):
        frames = np.full(FRAMES, round(TIMES[configuration] * slower**number))
        columns: dict[str, Any] = {
            "pk": number, "session_id": 1, "configuration_id": configuration, "repeat": seen[configuration],
            "order": number, "status": "ok", "ate_max": 0.01, "deviation": 0.0005, "cpu_us": None,
            "waited_us": None, "series": packing.Series(packing.pack(frames.tolist()), [], b"", b""),
            "mean_us": float(frames[0]), "fingerprint": None, "state": State.VALID, "reason": "",
        }  # fmt: skip
        stored.append(StoredRun(**columns | changes))
        seen[configuration] += 1
    return sorted(stored, key=lambda run: run.repeat)


def summaries(session: Sequence[StoredRun], **changes: Any) -> dict[int, SessionSummary]:
    """The summaries of one session, by configuration."""
    values: dict[str, Any] = {
        "key": 1, "cohort": 1, "installation": UUID(int=1), "started_at": STARTED, "day": STARTED.date(),
        "front": FRONT, "on_processor": False, "emulated": False, "released": False,
    }  # fmt: skip

    results = summarise([SessionInput(**values | changes)], {1: session})
    return {summary.configuration_id: summary for summary in results}


def reason(session: Sequence[StoredRun], **changes: Any) -> str:
    [summary] = summaries(session, **changes).values()
    return summary.reason


def test_a_whole_session_is_valid_and_has_its_own_interval() -> None:
    [summary] = summaries(runs(ABBA, slower=1.03)).values()
    [longer] = summaries(runs(ABBA * 2, slower=1.03)).values()

    assert (summary.state, summary.reason, summary.pairs) == (State.VALID, "", 2)
    assert summary.log_ratio == pytest.approx(math.log(2), abs=1e-4)
    assert longer.low < longer.log_ratio < longer.high


def test_half_a_session_on_a_device_that_slows_down_is_suspect() -> None:
    """Each run takes 14 % longer than the one before: without the way back 2.00 becomes 1.76."""
    [summary] = summaries(runs([DEFAULT, BEST], slower=1.14)).values()

    assert math.exp(summary.log_ratio or 0) == pytest.approx(2 / 1.14, rel=1e-3)
    assert (summary.state, summary.reason) == (State.SUSPECT, "incomplete_pairs")


@pytest.mark.parametrize("dropped", [0, 1, 2, 3])
def test_a_session_without_one_of_its_runs_is_suspect(dropped: int) -> None:
    left = [run for run in runs(ABBA) if run.order != dropped]

    assert reason(left) == "incomplete_pairs"


def test_a_run_that_does_not_count_is_missing() -> None:
    session = runs(ABBA)
    session[-1].state, session[-1].reason = State.INVALID, "ate_above_limit"

    assert reason(session) == "incomplete_pairs"


def test_an_order_that_does_not_go_back_is_suspect() -> None:
    in_one_place = runs(ABBA)
    for run in in_one_place:
        run.order = 0

    for session in (runs([DEFAULT, DEFAULT, BEST, BEST]), in_one_place):
        assert reason(session) == "unbalanced_order"


@pytest.mark.parametrize("slower", [1.06, 1 / 1.06])
def test_a_drift_that_cancels_in_the_pairs_is_shown_and_not_punished(slower: float) -> None:
    [summary] = summaries(runs(ABBA * 2, slower=slower)).values()

    assert (summary.state, summary.reason) == (State.VALID, "")
    assert summary.log_ratio == pytest.approx(math.log(2), abs=1e-3)
    assert summary.drift == pytest.approx((slower**4 + slower**7) / (1 + slower**3), rel=1e-3)


def test_a_speedup_that_changes_half_way_is_suspect() -> None:
    session = runs(ABBA * 2)
    for run in session:
        if run.configuration_id == BEST and run.repeat >= 2:
            run.mean_us = 1.6 * (run.mean_us or 0)

    assert reason(session) == "speedup_changed"


def test_a_session_that_other_programs_disturbed_counts_by_processor_time_or_is_suspect() -> None:
    session = runs(ABBA * 2)
    for run in session:
        run.cpu_us, run.waited_us = 3_000 if run.configuration_id == DEFAULT else 1_000, 0
    [undisturbed] = summaries(session).values()

    session[1].waited_us = 10**9
    [disturbed] = summaries(session).values()
    [by_processor] = summaries(session, on_processor=True).values()

    assert (undisturbed.reason, disturbed.reason, by_processor.reason) == ("", "contended", "")
    assert (undisturbed.clock, disturbed.clock, by_processor.clock) == ("wall", "wall", "processor")
    assert undisturbed.low is not None
    assert (disturbed.low, disturbed.high) == (None, None)
    assert disturbed.log_ratio == undisturbed.log_ratio
    assert by_processor.log_ratio == pytest.approx(math.log(3))
    assert by_processor.low == pytest.approx(math.log(3) - 1.96 * 0.15)


def test_runs_that_fail_or_lose_the_camera_are_counted() -> None:
    session = runs(ABBA)
    first, second = (run for run in session if run.configuration_id == BEST)
    first.state, first.reason = State.INVALID, rules.FAILED.code
    second.state, second.reason = State.INVALID, rules.ATE_ABOVE_LIMIT.code

    [summary] = summaries(session).values()

    assert (summary.runs, summary.failed, summary.lost) == (2, 1, 1)


def test_a_suspicion_on_a_run_is_one_on_its_session() -> None:
    session = runs(ABBA, state=State.SUSPECT, reason="stages_exceed_frames")

    assert reason(session) == "stages_exceed_frames"
    assert reason(session, emulated=True) == "emulator"


def test_an_administrator_releases_a_session_with_any_pair() -> None:
    assert reason(runs([DEFAULT, BEST]), released=True) == "released"
    assert reason(runs([DEFAULT, BEST], state=State.INVALID, reason="failed"), released=True) == "failed"


def test_a_session_without_the_default_has_no_summary() -> None:
    assert summaries(runs([BEST, BEST])) == {}
