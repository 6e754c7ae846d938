"""Whole explorations by tasks, each measurement in a fresh process."""

from crowd.explorations import services, tasks
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from crowd.fronts.models import FrontVersion
from tests.explorations.conftest import finish


def test_tasks_take_an_exploration_to_its_end(exploration: Exploration) -> None:
    exploration.budget, exploration.repeats = 1, 0
    exploration.save()
    # A queue in which no other test left a message.
    ReferenceDevice.objects.update(queue="unheard-of")
    finish(services.waiting(exploration)[1:])

    tasks.reap.delay()  # as a worker does when it starts; tasks run at once here

    exploration.refresh_from_db()
    assert exploration.state == "done"
    assert set(exploration.evaluations.values_list("state", flat=True)) == {"done"}
    assert exploration.evaluations.filter(phase="random").count() == 1


def test_a_task_for_a_finished_evaluation_does_nothing(exploration: Exploration) -> None:
    row = services.waiting(exploration)[0]
    Evaluation.objects.filter(pk=row.pk).update(state="failed", error="earlier")

    tasks.evaluate.delay(row.pk)

    row.refresh_from_db()
    assert (row.state, row.error, row.attempt) == ("failed", "earlier", 0)
    assert not FrontVersion.objects.exists()
