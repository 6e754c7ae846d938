"""Erasures, submissions and tasks at once, on a database that lets several write."""

import json
import threading
import uuid
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from typing import Any
from uuid import UUID

import numpy as np
import pyarrow.parquet
import pytest
from django.db import OperationalError, connection, connections

from crowd.devices.disclosure import public_device
from crowd.devices.models import Installation
from crowd.devices.services import enrol
from crowd.fronts.publishing.services import publish_content
from crowd.results import tasks
from crowd.results.figures import sessions as session_figures
from crowd.results.intake import storing
from crowd.results.intake.daily_limits import Sender
from crowd.results.models import DeviceActivity, DeviceSpeedup, MeasurementSession, Run, Tombstone
from crowd.results.opendata import exports, releases
from crowd.results.privacy import disclosure_sync, erasure
from tests.builders.documents import (
    FRAMES,
    device_document,
    front_document,
    run_document,
    session_document,
    submission_document,
)
from tests.crowd.exported import stored

pytestmark = [
    pytest.mark.django_db(transaction=True),
    pytest.mark.usefixtures("no_worker", "patient_database"),
]


@pytest.fixture
def patient_database(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let SQLite wait ten minutes for its lock: a busy machine would test its patience, not the code."""
    if connection.vendor == "sqlite":
        monkeypatch.setitem(connections.settings["default"]["OPTIONS"], "timeout", 600)


def enrolled() -> Installation:
    return enrol("client_kit", "0.1.0", 1)[0]


def send(who: Installation, *sessions: dict[str, Any], **changes: Any) -> None:
    document = submission_document(*sessions, **changes)
    storing.accept_submission(Sender(who), str(uuid.uuid4()), json.dumps(document).encode())


def at_once(*hands: Callable[[], Any]) -> list[Any]:
    """What `hands` answer, each a thread with a connection of its own."""

    def with_connection(hand: Callable[[], Any]) -> Any:
        try:
            return hand()
        finally:
            connection.close()

    with ThreadPoolExecutor(len(hands)) as threads:
        return list(threads.map(with_connection, hands))


@pytest.mark.slow
def test_all_runs_erased_at_once_take_their_session_with_them(front: Any) -> None:
    who, session = enrolled(), session_document()
    send(who, session)
    session_figures.summarise_waiting()
    runs = [UUID(run["id"]) for run in session["runs"]]

    erased = at_once(*(partial(erasure.erase_run, who, run) for run in runs * 2))

    assert sorted(erased) == [False] * 4 + [True] * 4
    assert not MeasurementSession.objects.exists()
    assert sorted(Tombstone.objects.values_list("kind", flat=True)) == ["run"] * 4 + ["session"]


@pytest.mark.slow
def test_a_copy_that_is_judged_beside_its_original_is_hidden(
    front: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    if connection.vendor == "sqlite":
        pytest.skip("SQLite judges one session after another")
    times = np.random.default_rng(0).normal(10_000, 200, FRAMES).astype(int).tolist()
    for model in ("Pixel 8", "Pixel 7"):
        runs = [run_document("default", 0, 0, 80_000), run_document("best", 0, 1, 10_000, frame_us=times)]
        send(enrolled(), session_document(runs=runs), device=device_document(model))
    both = threading.Barrier(2, timeout=60)
    insert = session_figures.insert

    def meet(rows: Any) -> None:
        # Both are judged, and none is committed.
        with suppress(threading.BrokenBarrierError):
            both.wait()
        insert(rows)

    monkeypatch.setattr(session_figures, "insert", meet)
    keys = MeasurementSession.objects.order_by("pk").values_list("pk", flat=True)

    at_once(*(partial(session_figures.summarise_session, key) for key in keys))
    both.abort()
    session_figures.summarise_waiting()

    reasons = Run.objects.filter(configuration__name="best").order_by("pk").values_list("reason", flat=True)
    assert list(reasons) == ["", "identical_series"]


@pytest.mark.slow
def test_nobody_is_refused_while_others_erase(
    transactional_db: None, pack: dict[str, Any], settings: Any
) -> None:
    """A task may lose against them: it is done again. What remains is as if one had come after the other."""
    settings.FRONTRUNNER_RARE_BELOW = 4
    leaving, staying = [enrolled() for _ in range(4)], [enrolled() for _ in range(2)]
    publish_content(front_document(pack, pairs=6))
    going_on, withdrawn, kept = (session_document(pairs=6) for _ in range(3))
    for who in leaving:
        send(who, session_document(), session_document())
    send(staying[0], going_on | {"runs": going_on["runs"][:4]})
    send(staying[1], withdrawn, kept)
    over = threading.Event()

    def work() -> None:
        # Workers pause between tasks (CELERY_BROKER_TRANSPORT_OPTIONS). SQLite's lock is not fair: who waits
        # for it tries every tenth of a second, and a loop that pauses for less can keep others from it.
        while not over.wait(0.15):
            keys = list(MeasurementSession.objects.values_list("pk", flat=True))
            with suppress(OperationalError):
                disclosure_sync.after_arrival(keys)
                session_figures.summarise_sessions(keys)

    def leave(who: Sequence[Installation]) -> None:
        for each in who:
            erasure.erase_installation(each)

    def withdraw() -> None:
        for run in withdrawn["runs"]:
            assert erasure.erase_run(staying[1], UUID(run["id"]))

    def go_on(places: Iterable[int]) -> None:
        for run in (going_on["runs"][place] for place in places):
            send(staying[0], going_on | {"runs": [run]})

    def all_people() -> None:
        try:
            at_once(
                partial(leave, leaving[:2]),
                partial(leave, leaving[2:]),
                withdraw,
                partial(go_on, range(4, 8)),
                partial(go_on, range(8, 12)),
            )
        finally:
            over.set()

    at_once(work, work, all_people)
    tasks.sweep()

    assert set(Installation.objects.all()) == set(staying)
    assert MeasurementSession.objects.count() == 2
    assert Run.objects.filter(session__uuid=going_on["id"]).count() == 12
    assert not session_figures.waiting_sessions().exists()
    assert (DeviceActivity.objects.get().sessions, DeviceSpeedup.objects.get().sessions) == (2, 2)
    assert public_device(DeviceSpeedup.objects.get().device).masked


@pytest.mark.slow
def test_no_export_serves_what_was_erased_while_it_was_made_or_rewritten(front: Any) -> None:
    people = [enrolled() for _ in range(8)]
    for who in people:
        send(who, session_document())
    session_figures.summarise_waiting()
    exports.create_export()
    leaving, staying = people[:6], people[6:]

    def leave(who: Sequence[Installation]) -> None:
        for each in who:
            erasure.erase_installation(each)

    def rewrite() -> None:
        for _ in range(10):
            exports.rewrite_all()

    at_once(partial(leave, leaving[:3]), partial(leave, leaving[3:]), exports.create_export, rewrite)

    # The first has the day's address, the second is the latest.
    assert len(releases.published_exports()) == 2
    left = set(Run.objects.values_list("uuid", flat=True))
    assert Installation.objects.count() == len(staying)
    for export in releases.published_exports():
        assert exports.rewrite_all()
        table = pyarrow.parquet.read_table(stored(export, "runs.parquet"))
        assert {UUID(key) for key in table.column("run").to_pylist()} == left
        assert export.files.get(name="tombstones.parquet").stored.rows == 6 * 6
