"""What a run measured in each frame is compressed without loss, stored once and deleted with its run."""

import re
import zlib
from typing import Any

import numpy as np
import pytest
from django.db import connection
from django.test.utils import CaptureQueriesContext
from hypothesis import given
from hypothesis import strategies as st

from crowd.results.figures import sessions as session_figures
from crowd.results.intake import packing
from crowd.results.models import MeasurementSession, Run, RunFrames
from tests.builders.documents import session_document, submission_document
from tests.builders.participant import Participant

TIMES = st.integers(0, packing.MAX_MICROSECONDS)
NAMES = st.lists(st.from_regex(r"[a-z][a-z0-9_]{0,31}", fullmatch=True), max_size=16, unique=True)


@st.composite
def measured(draw: st.DrawFn) -> packing.Series:
    """Any series that a submission may have: stages longer than their frame, too."""
    frames = draw(st.integers(0, 20))
    series = st.lists(TIMES, min_size=frames, max_size=frames)
    names, stages = packing.pack_stages({name: draw(series) for name in draw(NAMES)})
    tracked = draw(st.sampled_from([[], [None, True, False] * 7]))
    return packing.Series(packing.pack(draw(series)), names, stages, packing.pack_tracked(tracked[:frames]))


def noisy(random: np.random.Generator) -> packing.Series:
    """A run of 100 frames with five stages; times vary by 3 %."""
    stages = np.array([8, 16, 16, 40, 4])[:, None] * random.lognormal(0.0, 0.03, (5, 100)) * 1000
    times = stages.astype("<u4")
    frames = times.sum(axis=0) + random.integers(50, 300, 100)
    names = ["acquisition", "preprocessing", "tracking", "integration", "raycasting"]
    return packing.Series(frames.astype("<u4").tobytes(), names, times.tobytes(), bytes([1] * 100))


@given(measured())
def test_nothing_is_lost(series: packing.Series) -> None:
    assert packing.decompress(packing.compress(series)) == series
    assert packing.decompress(memoryview(packing.compress(series))) == series


def test_a_run_takes_less_than_half_of_its_bytes() -> None:
    random = np.random.default_rng(0)
    runs = [noisy(random) for _ in range(20)]

    assert {run.size for run in runs} == {2_500}
    assert np.mean([len(packing.compress(run)) for run in runs]) < 1_250


def test_what_was_stored_today_is_read_for_ever() -> None:
    stored = bytes.fromhex(
        "0178f999661af4636260601066802b472861d9c3c8c054c0f08e81914190e11f501523c37f063005005c080bfc"
    )

    assert packing.decompress(stored) == packing.Series(
        packing.pack([7, 300]),
        ["tracking", "raycasting"],
        packing.pack([1, 256, 2, 70_000]),
        bytes([packing.TRACKED, packing.LOST]),
    )


@pytest.mark.parametrize(
    ("damage", "error", "text"),
    [
        (lambda stored: b"\2" + stored[1:], ValueError, "format 2 of a run's series"),
        (lambda stored: stored[:-7], ValueError, "the rest is missing"),
        (lambda stored: stored[:40] + b"\0\0\0" + stored[43:], zlib.error, "while decompressing"),
    ],
    ids=["newer", "cut off", "changed"],
)
def test_damaged_series_are_not_read_as_others(damage: Any, error: type[Exception], text: str) -> None:
    stored = packing.compress(noisy(np.random.default_rng(0)))

    with pytest.raises(error, match=text):
        packing.decompress(damage(stored))


def test_frames_are_written_once_and_never_again(participant: Participant) -> None:
    with CaptureQueriesContext(connection) as queries:
        participant.submit(submission_document())
        session_figures.mark_for_summary(MeasurementSession.objects.all())
        session_figures.summarise_waiting()

    statements = [query["sql"] for query in queries]
    changing = [sql for sql in statements if re.search('(INTO|UPDATE|FROM) "results_runframes"', sql)]
    assert [sql for sql in statements if 'UPDATE "results_run"' in sql]
    assert len([sql for sql in changing if "INTO" in sql]) == len(changing) == 1


def test_frames_go_with_their_run(participant: Participant) -> None:
    sessions = [session_document(), session_document()]
    participant.submit(submission_document(*sessions))
    assert RunFrames.objects.count() == Run.objects.count() == 8

    participant.delete(f"/me/runs/{sessions[0]['runs'][0]['id']}")
    assert RunFrames.objects.count() == Run.objects.count() == 7
    participant.delete("/me")
    assert RunFrames.objects.count() == Run.objects.count() == 0
