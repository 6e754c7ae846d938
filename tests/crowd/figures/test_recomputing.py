"""Everything derived can be computed again from raw runs, at any time, in parts, beside others who do."""

import re
from typing import Any

import pytest
from django.core.management import CommandError, call_command
from django.db import connection

from crowd.results.figures import cohorts
from crowd.results.figures import sessions as session_figures
from crowd.results.models import (
    Cohort,
    DeviceActivity,
    DeviceSpeedup,
    MeasurementSession,
    Run,
    SessionSummary,
)
from tests.builders.crowds import Join
from tests.builders.documents import run_document, session_document, submission_document
from tests.builders.measuring import measure
from tests.builders.participant import Participant

DERIVED = {
    Run: ("uuid", "mean_us", "fingerprint", "state", "reason"),
    SessionSummary: ("session__uuid", "configuration__name", "log_ratio", "pairs", "drift", "state", "reason",
                     "day", "counted"),
    DeviceSpeedup: ("device__slug", "configuration__name", "speedup", "low", "high", "repeat_low",
                    "repeat_high", "sessions", "installations", "ate_max", "state", "last_session_at"),
    DeviceActivity: ("device__slug", "sessions", "installations", "last_session_at"),
}  # fmt: skip

BEST_US = (10_000, 10_500, 11_000, 11_500, 2_000)


def derived() -> dict[str, list[tuple[Any, ...]]]:
    """All that is derived, without keys and dates of computation."""
    return {
        model.__name__: sorted(model._default_manager.values_list(*names), key=str)
        for model, names in DERIVED.items()
    }


@pytest.fixture
def crowd(participant: Participant, join: Join) -> None:
    """Two devices, five participants, seven sessions: valid ones, a suspect, an invalid one, an outlier."""
    for who, best_us in zip((participant, participant, join(), join(), join()), BEST_US, strict=True):
        measure(who, best_us=best_us)
    hot = [run_document("default", 0, 0, 80_000), run_document("best", 0, 1, 10_000)]
    hot.append(run_document("best", 1, 2, 20_000))
    lost = [run_document("default", 0, 0, 80_000), run_document("best", 0, 1, 9_000, ate_max=0.3)]
    other = join()
    for runs in (hot, lost):
        measure(other, "Pixel 9", runs=runs)


def test_recomputing_everything_changes_nothing(crowd: None) -> None:
    before = derived()
    assert {row[5] for row in before["SessionSummary"]} == {"valid", "suspect", "invalid", "quarantined"}

    call_command("results", "recompute", "--all")

    assert derived() == before


@pytest.mark.slow
def test_what_was_lost_or_spoilt_is_computed_again(crowd: None) -> None:
    before = derived()
    for model in (SessionSummary, DeviceSpeedup, DeviceActivity, Cohort):
        model.objects.all().delete()
    Run.objects.update(mean_us=1.0, fingerprint=None, state="valid", reason="")

    call_command("results", "recompute", "--all")

    assert derived() == before


def test_only_the_sessions_of_a_device_or_of_a_part_are_computed_again(
    crowd: None, capsys: pytest.CaptureFixture[str]
) -> None:
    call_command("results", "recompute", "--device", "google-pixel-9")
    assert "2 sessions to summarise again" in capsys.readouterr().out

    call_command("results", "recompute", "--all", "--part", "1/100000")
    assert "0 sessions summarised in all" in capsys.readouterr().out

    with pytest.raises(CommandError, match="no session"):
        call_command("results", "recompute", "--front", "kfusion-none")


def test_an_interrupted_recomputation_goes_on_where_it_stopped(
    crowd: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = derived()
    monkeypatch.setattr(session_figures, "BATCH", 2)
    real, parts = session_figures.summarise_sessions, []

    def interrupted(keys: list[int], figures: bool = True) -> None:
        if len(parts) == 2:
            raise KeyboardInterrupt
        parts.append(keys)
        real(keys, figures)

    monkeypatch.setattr(session_figures, "summarise_sessions", interrupted)
    with pytest.raises(KeyboardInterrupt):
        call_command("results", "recompute", "--all")
    monkeypatch.setattr(session_figures, "summarise_sessions", real)
    assert session_figures.waiting_sessions().count() == 3
    figures = derived()["DeviceSpeedup"]
    assert figures == before["DeviceSpeedup"]  # they hold meanwhile

    call_command("results", "recompute")

    assert "3 sessions summarised in all" in capsys.readouterr().out
    assert derived() == before
    assert not Cohort.objects.filter(stale=True).exists()


def test_figures_of_a_device_with_many_sessions_come_with_the_sweep(
    participant: Participant, monkeypatch: pytest.MonkeyPatch
) -> None:
    participant.submit(submission_document())
    monkeypatch.setattr(session_figures, "LARGE_DEVICE_SESSIONS", 0)

    measure(participant, best_us=20_000)
    assert DeviceSpeedup.objects.get().sessions == 1

    session_figures.refresh_stale()
    figure = DeviceSpeedup.objects.get()
    assert (figure.sessions, figure.speedup) == (2, pytest.approx((8 * 4) ** 0.5))
    assert DeviceActivity.objects.get().sessions == 2


def test_sessions_that_move_to_another_device_take_their_figures_along(
    participant: Participant, join: Join
) -> None:
    measure(participant)
    measure(join(), "Pixel 9")
    moved = MeasurementSession.objects.latest("pk")
    MeasurementSession.objects.filter(pk=moved.pk).update(
        device=MeasurementSession.objects.earliest("pk").device
    )

    session_figures.mark_for_summary(MeasurementSession.objects.filter(pk=moved.pk))
    session_figures.summarise_waiting()

    assert DeviceSpeedup.objects.get().sessions == 2
    assert Cohort.objects.get().summaries.count() == 2
    assert DeviceActivity.objects.get().sessions == 2


def test_what_one_more_session_asks_of_the_database_does_not_grow(
    participant: Participant, django_assert_max_num_queries: Any
) -> None:
    for _ in range(4):
        participant.submit(submission_document())
    session = MeasurementSession.objects.latest("pk")

    with django_assert_max_num_queries(32):
        session_figures.summarise_session(session.pk)


def test_a_sweep_takes_many_sessions_for_few_queries(
    participant: Participant, no_worker: None, django_assert_max_num_queries: Any
) -> None:
    participant.submit(submission_document(*(session_document() for _ in range(12))))

    with django_assert_max_num_queries(41):
        session_figures.summarise_waiting()
    assert SessionSummary.objects.count() == 12


def test_parts_and_then_the_rest_give_the_same_as_one_process(
    crowd: None, capsys: pytest.CaptureFixture[str]
) -> None:
    before = derived()
    for model in (SessionSummary, DeviceSpeedup, DeviceActivity, Cohort):
        model.objects.all().delete()
    MeasurementSession.objects.update(summary_algorithm=None)

    for part in ("2/2", "1/2"):
        call_command("results", "recompute", "--part", part)
        assert not DeviceSpeedup.objects.exists()
    summarised = re.findall(r"(\d) sessions summarised in all", capsys.readouterr().out)
    call_command("results", "recompute")

    assert sum(map(int, summarised)) == 7
    assert derived() == before


def test_means_do_not_depend_on_where_the_rows_lie(participant: Participant) -> None:
    """Another process stores them in another order, and floats add up to another sum in it."""
    if connection.vendor == "sqlite":
        pytest.skip("SQLite has one writer, and no order in sums before its version 3.44")
    participant.submit(submission_document(*(session_document() for _ in range(3))))
    summaries = list(SessionSummary.objects.order_by("session_id"))
    for summary, log_ratio in zip(summaries, (1.0, 1e16, -1e16), strict=True):
        summary.log_ratio = log_ratio
    with connection.cursor() as cursor:
        cursor.execute("SET LOCAL enable_indexscan = off; SET LOCAL enable_bitmapscan = off")
    means = []
    for rows in (summaries, summaries[::-1]):
        SessionSummary.objects.all().delete()
        for row in rows:
            row.pk = None
            row.save(force_insert=True)
        [group] = cohorts._by_installation(SessionSummary.objects.all())
        means.append(group["mean"])

    assert means == [0.0, 0.0]


@pytest.mark.parametrize("part", ["0/4", "5/4", "4", "a/b", "1/0"])
def test_a_part_that_does_not_exist_is_refused(part: str) -> None:
    with pytest.raises(CommandError, match=f"'{part}' is not a part: write 1/4"):
        call_command("results", "recompute", "--part", part)
