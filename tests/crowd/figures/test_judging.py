"""Many runs are judged at once, each as its own content asks for. No database in here."""

from typing import Any
from uuid import UUID

import numpy as np

from crowd.results.intake import packing
from crowd.results.models import State
from crowd.results.validity import rules, runs
from crowd.results.validity.runs import DERIVED_COLUMNS, READ_COLUMNS, Front, SessionContext, StoredRun
from wire.front import Protocol
from wire.protocol import VERSION

FRAMES = 100
PROTOCOL = Protocol(VERSION, 10, FRAMES, 10, ("default", "best"), repeats=2, rest_seconds=0)
BAND = 0.003
SKIPPED = 0.6  # by configuration 2 on the reference
AROUND = {1: SessionContext(UUID(int=1), Front(1, PROTOCOL, {1, 2}, 1, {1: BAND}, skipped={2: SKIPPED}))}
ADAPTS = {"configuration_id": 2, "shares": {}}
# What was sent, and the rule that it breaks.
SENT: dict[str, tuple[dict[str, Any], str]] = {
    "ordinary": ({}, ""),
    "without stages": ({"shares": {}}, ""),
    "stages too long": ({"shares": {"tracking": 0.9, "raycasting": 0.4}}, "stages_exceed_frames"),
    "stages outside of the computation": ({"shares": {"acquisition": 3.0}}, ""),
    "coarse clock": ({"unit": 20_000}, ""),
    "too quick": ({"level": 20}, "implausible_time"),
    "slow": ({"level": 4_000_000_000}, ""),
    "failed": ({"frames": 7, "status": "failed"}, "failed"),
    "failed at once": ({"frames": 0, "status": "failed"}, "failed"),
    "too few frames": ({"frames": 99}, "frame_count"),
    "no error reported": ({"ate_max": None}, "ate_missing"),
    "lost": ({"ate_max": 0.05}, "ate_above_limit"),
    "within its band": ({"deviation": BAND}, ""),
    "outside its band": ({"deviation": 1.01 * BAND}, "deviation_above_band"),
    "tracks some frames": ({"left_out": 0.9}, ""),
    "too quick where it does not track": ({"left_out": 0.9, "level": 20}, "implausible_time"),
    "leaves out as many": (ADAPTS | {"left_out": SKIPPED}, ""),
    "quick because it leaves out most": (ADAPTS | {"left_out": SKIPPED, "level": 120}, ""),
    "too quick where it computes": (ADAPTS | {"left_out": SKIPPED, "level": 40}, "implausible_time"),
    "leaves out a few more": (ADAPTS | {"left_out": SKIPPED + 0.09}, ""),
    "leaves out many more": (ADAPTS | {"left_out": SKIPPED + 0.12}, "skipped_share"),
    "leaves out many fewer": (ADAPTS | {"left_out": SKIPPED - 0.12}, "skipped_share"),
    "leaves out frames that take longer": (
        ADAPTS | {"left_out": SKIPPED, "left_out_us": 50_000},
        "skipped_times",
    ),
    "leaves out all": (ADAPTS | {"left_out": 1.0}, "implausible_time"),
    "does not say what it left out": (ADAPTS, "skipped_share"),
    "lost outside its band": ({"ate_max": 0.06, "deviation": 0.06}, "ate_above_limit"),
}
# Too few different times.
COARSE = {"coarse clock", "too quick", "failed", "failed at once", "too quick where it does not track"}


def sent(random: np.random.Generator, case: dict[str, Any]) -> dict[str, Any]:
    """The columns of a run as it came in."""
    level, unit = case.get("level", 40_000), case.get("unit", 1)
    times = (random.lognormal(0.0, 0.01, case.get("frames", FRAMES)) * level).astype(np.uint64) // unit * unit
    left_out = np.zeros(len(times), dtype=bool)
    if share := case.get("left_out"):
        left_out[10:] = np.floor(np.arange(1, 91) * share) > np.floor(np.arange(90) * share)
    if case.get("configuration_id") == 2:
        times[left_out] = case.get("left_out_us", 2)
    shares = case.get("shares", {"tracking": 0.3, "raycasting": 0.6})
    names, stages_us = packing.pack_stages(
        {name: (times * share).astype(int).tolist() for name, share in shares.items()}
    )
    columns = {"status": "ok", "ate_max": 0.01, "deviation": 0.0005} | {
        name: value for name, value in case.items() if name in READ_COLUMNS
    }
    told = [None if skipped else True for skipped in left_out] if "left_out" in case else []
    series = packing.Series(packing.pack(times.tolist()), names, stages_us, packing.pack_tracked(told))
    return columns | {
        "series": series,
        "repeat": 0,
        "order": 0,
        "session_id": 1,
        "configuration_id": case.get("configuration_id", 1),
    }


def judged(rows: list[dict[str, Any]]) -> list[StoredRun]:
    unknown: dict[str, Any] = dict.fromkeys(DERIVED_COLUMNS)
    unknown |= {"cpu_us": None, "waited_us": None}
    stored = [StoredRun(**row, **unknown, pk=key) for key, row in enumerate(rows)]
    runs.judge_alone(stored, AROUND)
    return stored


def derived(run: StoredRun) -> tuple[Any, ...]:
    return tuple(getattr(run, name) for name in DERIVED_COLUMNS)


def test_each_of_many_runs_breaks_its_own_rule() -> None:
    random = np.random.default_rng(0)
    cases = [(name, *case) for name, case in SENT.items() for _ in range(3)]

    many = judged([sent(random, case) for _, case, _ in cases])

    assert [run.reason for run in many] == [reason for _, _, reason in cases]
    assert [run.state for run in many] == [
        rules.RULES[reason].state if reason else State.VALID for _, _, reason in cases
    ]
    for run, (name, case, _) in zip(many, cases, strict=True):
        assert case.get("configuration_id") == 2 or (run.fingerprint is None) == (name in COARSE)
    for run in many:
        frames = packing.unpack(run.series.frame_us)
        counted = frames.size > PROTOCOL.first_counted_frame
        assert run.mean_us == (float(frames[10:].mean()) if counted else None)
        assert run.fingerprint in {None, runs.fingerprint(run.series.frame_us)}


def test_many_runs_are_judged_as_each_by_itself() -> None:
    random = np.random.default_rng(0)
    rows = [sent(random, case) for case, _ in SENT.values() for _ in range(3)]

    assert [derived(run) for run in judged(rows)] == [derived(judged([row])[0]) for row in rows]
