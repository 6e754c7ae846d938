"""How many evaluations share a message."""

from datetime import timedelta

import pytest
from django.utils import timezone

from crowd.explorations import services, tasks
from crowd.explorations.measuring.task_batching import batch_size
from crowd.explorations.models import Evaluation, Exploration
from tests.builders.explorations import finish, measurement


@pytest.mark.parametrize(
    ("waiting", "machines", "seconds", "size"),
    [
        (100, 4, None, 1),  # their duration is unknown
        (100, 4, 20.0, 1),
        (100, 4, 0.001, 6),  # each machine has four messages to choose from
        (1000, 1, 0.1, 5),  # half a second of them
        (1000, 1, 0.0, 250),
        (3, 4, 0.001, 1),
        (0, 1, 0.001, 1),
    ],
)
def test_quick_measurements_share_messages(
    waiting: int, machines: int, seconds: float | None, size: int
) -> None:
    assert batch_size(waiting, machines, seconds) == size


def test_every_evaluation_is_announced_once_in_order(
    exploration: Exploration, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[list[int]] = []
    monkeypatch.setattr(tasks.evaluate, "apply_async", lambda args, **_: sent.append(args))
    exploration.batch = exploration.budget = 9
    exploration.save()
    finish(services.pending_evaluations(exploration))
    now = timezone.now()
    exploration.evaluations.update(started_at=now - timedelta(milliseconds=1), finished_at=now)

    tasks.advance(exploration.pk)

    waiting = [row.pk for row in services.pending_evaluations(exploration)]
    assert [len(keys) for keys in sent] == [2, 2, 2, 2, 1]
    assert [key for keys in sent for key in keys] == waiting


def test_what_somebody_else_has_finished_keeps_no_other_of_a_message_from_being_measured(
    exploration: Exploration, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken, *others = services.pending_evaluations(exploration)[:3]
    Evaluation.objects.filter(pk=taken.pk).update(state="failed", error="by somebody else")
    monkeypatch.setattr(tasks, "_measure", lambda row: measurement(row.configuration))

    tasks.evaluate(taken.pk, *(row.pk for row in others))

    assert [Evaluation.objects.get(pk=row.pk).state for row in others] == ["done", "done"]
    taken.refresh_from_db()
    assert (taken.error, taken.attempt) == ("by somebody else", 0)
