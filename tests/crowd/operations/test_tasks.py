"""Messages only hurry things along: the rows know what is still to be done."""

import pytest
from django.core.management import call_command

from crowd.celery import app
from crowd.results import tasks
from crowd.results.models import DeviceSpeedup, MeasurementSession, SessionSummary
from crowd.results.validity import version
from tests.builders.documents import session_document, submission_document
from tests.builders.participant import Participant


def test_a_sweep_finds_what_no_message_reached(participant: Participant, no_worker: None) -> None:
    key = participant.submit(submission_document()).json()["submission_id"]
    assert not participant.get(f"/submissions/{key}").json()["summarised"]

    tasks.sweep()

    assert participant.get(f"/submissions/{key}").json()["summarised"]
    assert DeviceSpeedup.objects.get().speedup == pytest.approx(8.0)


def test_a_task_may_run_twice(participant: Participant) -> None:
    participant.submit(submission_document())
    session = MeasurementSession.objects.get()

    tasks.summarise.delay(session.pk)

    assert SessionSummary.objects.count() == 1
    assert DeviceSpeedup.objects.get().sessions == 1


def test_a_task_for_a_session_that_was_erased_does_nothing(participant: Participant) -> None:
    participant.submit(submission_document())
    session = MeasurementSession.objects.get()
    participant.delete("/me")

    tasks.summarise.delay(session.pk)

    assert not SessionSummary.objects.exists()


def test_a_new_algorithm_computes_everything_anew(
    participant: Participant, monkeypatch: pytest.MonkeyPatch
) -> None:
    participant.submit(submission_document())
    monkeypatch.setattr(version, "ALGORITHM", version.ALGORITHM + 1)

    tasks.sweep.delay()

    assert SessionSummary.objects.get().algorithm == version.ALGORITHM
    assert DeviceSpeedup.objects.get().algorithm == version.ALGORITHM


def test_everything_can_be_computed_again_from_raw_runs(
    participant: Participant, capsys: pytest.CaptureFixture[str]
) -> None:
    participant.submit(submission_document())
    participant.submit(submission_document(session_document(best_us=20_000)))
    before = list(DeviceSpeedup.objects.values("speedup", "sessions", "installations", "state"))
    SessionSummary.objects.all().delete()
    DeviceSpeedup.objects.all().delete()

    call_command("results", "recompute", "--all")

    assert "2 sessions summarised in all" in capsys.readouterr().out
    assert list(DeviceSpeedup.objects.values("speedup", "sessions", "installations", "state")) == before


def test_a_worker_that_was_away_finds_one_message_of_each_periodic_task() -> None:
    for entry in app.conf.beat_schedule.values():
        assert 0 < entry["options"]["expires"] <= entry["schedule"]
