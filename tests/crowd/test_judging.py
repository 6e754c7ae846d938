"""Many runs judged at once have the same outcome as each judged alone, to the last bit. No database."""

from typing import Any
from uuid import UUID

import numpy as np

from crowd.results.intake import packing
from crowd.results.intake.checks import Protocol
from crowd.results.validity import runs
from crowd.results.validity.runs import DERIVED, READ, Front, SessionContext, StoredRun

FRAMES = 100
PROTOCOL = Protocol(version=1, frames=FRAMES, first_counted_frame=10, max_ate=0.05, repeats=2)
AROUND = {1: SessionContext(UUID(int=1), Front(1, PROTOCOL, {1}, 1))}
SENT: dict[str, dict[str, Any]] = {
    "ordinary": {},
    "without stages": {"shares": {}},
    "stages too long": {"shares": {"tracking": 0.9, "raycasting": 0.4}},
    "stages outside of the computation": {"shares": {"acquisition": 3.0}},
    "coarse clock": {"unit": 20_000},
    "too quick": {"level": 20},
    "slow": {"level": 4_000_000_000},
    "failed": {"frames": 7, "status": "failed"},
    "failed at once": {"frames": 0, "status": "failed"},
    "too few frames": {"frames": 99},
    "no error reported": {"ate_max": None},
    "lost": {"ate_max": 0.05},
    "no trajectory": {"trajectory_sha256": ""},
}


def sent(random: np.random.Generator, case: dict[str, Any]) -> dict[str, Any]:
    """The columns of a run as it came in."""
    level, unit = case.get("level", 40_000), case.get("unit", 1)
    times = (random.lognormal(0.0, 0.01, case.get("frames", FRAMES)) * level).astype(np.uint64) // unit * unit
    shares = case.get("shares", {"tracking": 0.3, "raycasting": 0.6})
    names, stages_us = packing.pack_stages(
        {name: (times * share).astype(int).tolist() for name, share in shares.items()}
    )
    columns = {"status": "ok", "ate_max": 0.01, "trajectory_sha256": "0" * 64} | {
        name: value for name, value in case.items() if name in READ
    }
    return columns | {
        "frame_us": packing.pack(times.tolist()),
        "stages": names,
        "stages_us": stages_us,
        "repeat": 0,
        "order": 0,
        "session_id": 1,
        "configuration_id": 1,
    }


def stored(rows: list[dict[str, Any]]) -> list[StoredRun]:
    unknown: dict[str, Any] = dict.fromkeys(DERIVED)
    return [StoredRun(**row, **unknown, pk=key) for key, row in enumerate(rows)]


def derived(run: StoredRun) -> tuple[Any, ...]:
    return tuple(getattr(run, name) for name in DERIVED)


def test_many_runs_are_judged_as_each_by_itself() -> None:
    random = np.random.default_rng(0)
    rows = [sent(random, case) for case in SENT.values() for _ in range(3)]
    alone, many = stored(rows), stored(rows)
    for run in alone:
        runs._judge_all([run], AROUND)

    runs._judge_all(many, AROUND)

    assert [derived(run) for run in many] == [derived(run) for run in alone]
    assert len({run.reason for run in many}) == 8  # every rule on a run by itself, and none
    assert {run.fingerprint is None for run in many} == {True, False}
