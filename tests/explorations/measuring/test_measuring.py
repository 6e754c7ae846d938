"""Whole explorations by tasks, each measurement in a fresh process, and workers that cannot go on."""

from typing import Any

import pytest
from celery.exceptions import WorkerShutdown
from celery.signals import worker_shutting_down
from django.db import transaction
from kombu.exceptions import OperationalError

from crowd.explorations import services, tasks
from crowd.explorations.measuring import graceful_shutdown
from crowd.explorations.measuring.graceful_shutdown import ShutdownSwitch
from crowd.explorations.measuring.measurement import Measurement
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from crowd.fronts.models import FrontVersion
from tests.builders.explorations import finish, measurement


@pytest.mark.slow
def test_tasks_take_an_exploration_to_its_end(exploration: Exploration, committing: Any) -> None:
    exploration.budget, exploration.repeats = 1, 0
    exploration.save()
    # A queue in which no other test left a message.
    ReferenceDevice.objects.update(queue="unheard-of")
    finish(services.pending_evaluations(exploration)[1:])

    with committing():
        tasks.reap.delay()  # as a worker does when it starts; tasks run at once here

    exploration.refresh_from_db()
    assert exploration.state == "done"
    assert set(exploration.evaluations.values_list("state", flat=True)) == {"done"}
    assert exploration.evaluations.filter(phase="random").count() == 1


def test_a_task_for_a_finished_evaluation_does_nothing(exploration: Exploration) -> None:
    row = services.pending_evaluations(exploration)[0]
    Evaluation.objects.filter(pk=row.pk).update(state="failed", error="earlier")

    tasks.evaluate.delay(row.pk)

    row.refresh_from_db()
    assert (row.state, row.error, row.attempt) == ("failed", "earlier", 0)
    assert not FrontVersion.objects.exists()


@pytest.mark.slow
def test_a_machine_without_the_sequence_or_the_device_gives_back_and_the_reason_is_noted(
    exploration: Exploration, settings: Any
) -> None:
    row, other = services.pending_evaluations(exploration)[:2]
    ReferenceDevice.objects.update(opencl_device="abacus")
    for _ in range(4):  # more often than a worker may be lost
        tasks.evaluate(row.pk)
    row.refresh_from_db()
    exploration.refresh_from_db()
    assert (row.state, row.losses, row.error, row.lease_until) == ("pending", 0, "", None)
    assert "a machine of bench cannot measure: " in exploration.note
    assert "no OpenCL device matches 'abacus'" in exploration.note

    settings.FRONTRUNNER_SEQUENCES = []
    tasks.evaluate(other.pk)
    exploration.refresh_from_db()
    assert "no pack tiny with digest" in exploration.note
    assert exploration.evaluations.filter(state="pending").count() == 5

    finish([row])  # another machine can
    exploration.refresh_from_db()
    assert exploration.note == ""


@pytest.fixture
def ended_by_a_signal(monkeypatch: pytest.MonkeyPatch) -> None:
    """A measurement that a signal ends halfway."""
    monkeypatch.setattr(graceful_shutdown, "shutdown", ShutdownSwitch())

    def measure(evaluation: Evaluation, _: Any) -> Measurement:
        worker_shutting_down.send(sender="bench@here", sig="SIGTERM", how="Warm", exitcode=0)
        return measurement(evaluation.configuration)

    monkeypatch.setattr(tasks, "evaluator", lambda: measure)


def test_a_worker_that_shuts_down_gives_back_what_it_measures(
    exploration: Exploration, ended_by_a_signal: None
) -> None:
    row = services.pending_evaluations(exploration)[0]

    with pytest.raises(WorkerShutdown):
        tasks.evaluate(row.pk)

    row.refresh_from_db()
    assert (row.state, row.losses, row.lease_until) == ("pending", 0, None)


def test_an_end_waits_for_what_must_not_be_interrupted() -> None:
    measuring, done = ShutdownSwitch(), []

    def measure() -> None:
        with measuring.interruptible():
            with measuring.protected():
                measuring.request()
                done.append("the write")
            done.append("the rest")

    with pytest.raises(WorkerShutdown):
        measure()
    measuring.request()  # outside of a measurement nothing is interrupted
    with pytest.raises(WorkerShutdown):
        measure()
    assert done == ["the write"]


def test_messages_are_sent_when_the_rows_that_they_tell_of_are_stored(
    exploration: Exploration, monkeypatch: pytest.MonkeyPatch, committing: Any
) -> None:
    sent: list[list[int]] = []
    monkeypatch.setattr(tasks.evaluate, "apply_async", lambda args, **_: sent.append(args))

    with committing(), transaction.atomic():
        tasks.dispatch(exploration)
        assert sent == []

    assert sent == [[row.pk] for row in services.pending_evaluations(exploration)]


def test_of_a_broker_that_is_gone_no_more_than_one_message_is_asked(
    exploration: Exploration, monkeypatch: pytest.MonkeyPatch, committing: Any
) -> None:
    tried: list[list[int]] = []

    def refuse(args: list[int], **_: Any) -> None:
        tried.append(args)
        raise OperationalError("connection refused")

    monkeypatch.setattr(tasks.evaluate, "apply_async", refuse)

    with committing():
        tasks.dispatch(exploration)

    assert len(tried) == 1
