"""What a session comes to is the same in JavaScript and in Python."""

from __future__ import annotations

import random
import uuid
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace

from client_kit.delivery.manifest import Manifest
from client_kit.measuring.session import Run, begin
from tests.builders import manifests
from tests.client_kit.web.serving import evaluated
from wire import session_statistics

BANDS = {"default": 0.002, "best": 0.01}
ASKED = Manifest.parse(
    manifests.manifest(
        configurations=[manifests.configuration(name, {}, band=band) for name, band in BANDS.items()]
    )
)
STAGES = ("preprocessing", "tracking")
COMPUTE = """async ({ sessions, protocol, bands }) => {
    const speedup = await import("/measure/speedup.js");
    const found = (runs) => speedup.speedupOf(runs, "best", protocol, bands);
    return sessions.map((runs) => ({
        speedup: found(runs),
        wide: found(runs) && speedup.isWide(found(runs)),
        slower: speedup.slowedDown(runs, protocol),
        valid: runs.map((run) => speedup.isValid(run, protocol, bands)),
        seconds: runs.map((run) => run.frame_us.length ? speedup.meanSeconds(run, protocol) : null),
        stages: runs.map((run) => run.frame_us.length ? speedup.stageSeconds(run, protocol) : null),
    }));
}"""


def made_up_run(chance: random.Random, name: str, repeat: int, order: int, slower: int) -> Run:
    failed = chance.random() < 0.1
    frames = [slower * chance.randrange(1 if chance.random() < 0.9 else 0, 50_000) for _ in range(12)]
    deviation = None if failed else BANDS[name] * chance.choice([0.1, 0.9, 1.0, 1.1])
    return Run(
        uuid.UUID(int=order),
        name,
        repeat,
        order,
        "failed" if failed else "ok",
        [] if failed else frames,
        failure="out of memory" if failed else None,
        stages_us={} if failed else {stage: [time // 3 for time in frames] for stage in STAGES},
        ate_max=None if failed else chance.choice([0.001, 0.049, 0.05, None]),
        deviation=deviation,
    )


def made_up_session(seed: int) -> tuple[Run, ...]:
    chance = random.Random(seed)
    names = [name for _ in range(chance.randrange(0, 26)) for name in ("default", "best")]
    if chance.random() < 0.5:
        chance.shuffle(names)
    names = names[: chance.randrange(len(names) + 1)] if chance.random() < 0.3 else names
    later = chance.choice([{}, {"best": 40}, {"best": 40}, {"default": 40, "best": 40}])
    slower = dict.fromkeys(names, 1) | later
    return tuple(
        made_up_run(
            chance,
            name,
            names[:order].count(name),
            order,
            slower[name] if 2 * order >= len(names) else 1,
        )
        for order, name in enumerate(names)
    )


def document(run: Run) -> dict[str, Any]:
    """A run as the worker sends it."""
    nothing = {"failure": None, "stages_us": {}, "ate_max": None}
    return nothing | msgspec.to_builtins(run)


@pytest.mark.slow
def test_random_sessions_come_to_what_python_computes(web_page: Any) -> None:
    sessions = [made_up_session(seed) for seed in range(600)]
    order = {
        "sessions": [[document(run) for run in runs] for runs in sessions],
        "protocol": {"first_counted_frame": 4, "max_ate": 0.05},
        "bands": BANDS,
    }

    found = evaluated(web_page, COMPUTE, order)

    intervals = changes = wide = slowdowns = 0
    for runs, result in zip(sessions, found, strict=True):
        session = replace(begin(ASKED, "webgpu", None), runs=runs)
        speedup = session.speedup("best", ASKED)
        if speedup is None:
            assert result["speedup"] is None
        else:
            intervals += speedup.low is not None
            changes += speedup.changed
            is_wide = session_statistics.wide_range(speedup.low, speedup.high) is not None
            wide += is_wide
            assert result["wide"] == is_wide
            for name in ("value", "low", "high", "pairs", "changed"):
                value = getattr(speedup, name)
                assert result["speedup"][name] == (None if value is None else pytest.approx(value, rel=1e-9))
        slower = session.slowed_down(ASKED.protocol)
        slowdowns += slower is not None
        assert result["slower"] == (None if slower is None else pytest.approx(slower, rel=1e-9))
        assert result["valid"] == [run.valid(ASKED) for run in runs]
        for run, seconds, stages in zip(runs, result["seconds"], result["stages"], strict=True):
            if run.frame_us:
                assert seconds == pytest.approx(run.mean_seconds(ASKED.protocol), rel=1e-12)
                assert stages == pytest.approx(run.stage_seconds(ASKED.protocol), rel=1e-12)
    assert intervals >= 20
    assert changes >= 3
    assert 0 < wide < intervals
    assert slowdowns >= 3


@pytest.mark.slow
def test_runs_without_stage_times_have_none(web_page: Any) -> None:
    run = document(made_up_run(random.Random(1), "default", 0, 0, 1)) | {"frame_us": [1] * 12}
    del run["stages_us"]
    order = {"sessions": [[run]], "protocol": {"first_counted_frame": 4, "max_ate": 0.05}, "bands": BANDS}

    [found] = evaluated(web_page, COMPUTE, order)

    assert found["stages"] == [{}]
