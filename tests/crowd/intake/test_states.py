"""Which rule hides what, through the API and all the way to the figures."""

from typing import Any

import numpy as np
import pytest
from django.test import Client

from crowd.devices.models import DeviceModel
from crowd.fronts.publishing.services import publish_content
from crowd.results import moderation
from crowd.results.figures import sessions as session_figures
from crowd.results.models import DeviceSpeedup, MeasurementSession, Run, SessionSummary, State
from crowd.results.validity import rules
from tests.builders.crowds import Join, crowd, send, session_of
from tests.builders.documents import (
    FRAMES,
    adaptive_front_document,
    front_document,
    run_document,
)
from tests.builders.measuring import in_balanced_order, measure
from tests.builders.participant import Participant


def varied(frame_us: int, seed: int) -> list[int]:
    """Times as a fine clock tells them, of that mean within a percent."""
    return np.random.default_rng(seed).normal(frame_us, frame_us * 0.02, FRAMES).astype(int).tolist()


def abba(default_us: int = 80_000) -> list[dict[str, Any]]:
    """Default, best, best, default: the first run of best has been timed with a fine clock."""
    first, best, *rest = in_balanced_order({"default": default_us, "best": 10_000})
    return [first, best | {"frame_us": varied(10_000, 1)}, *rest]


def states() -> list[tuple[str, str]]:
    return list(SessionSummary.objects.order_by("session_id").values_list("state", "reason"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "state", "rule"),
    [
        ({"status": "failed", "failure": "out of memory"}, State.INVALID, rules.FAILED),
        ({"ate_max": None}, State.INVALID, rules.ATE_MISSING),
        ({"ate_max": 0.05}, State.INVALID, rules.ATE_ABOVE_LIMIT),
        ({"frame_us": [49] * FRAMES, "stages_us": None}, State.INVALID, rules.IMPLAUSIBLE_TIME),
        ({"stages_us": {"tracking": [11_000] * FRAMES}}, State.SUSPECT, rules.STAGES_EXCEED_FRAMES),
    ],
    ids=lambda value: getattr(value, "code", None),
)
def test_a_run_that_breaks_a_rule_says_which(
    participant: Participant, changes: dict[str, Any], state: State, rule: rules.Rule
) -> None:
    first, *best, last = in_balanced_order({"default": 80_000, "best": 10_000})
    measure(participant, runs=[first, *(run | changes for run in best), last])

    best = Run.objects.filter(configuration__name="best")
    assert [(run.state, run.reason) for run in best] == [(rule.state, rule.code)] * 2
    assert states() == [(state, rule.code)]


def test_half_a_session_on_a_device_that_slows_down_is_suspect(participant: Participant) -> None:
    """Each run takes 14 % longer than the one before: without the way back 2.00 becomes 1.76."""
    measure(participant, runs=[run_document("default", 0, 0, 80_000), run_document("best", 0, 1, 45_600)])

    assert states() == [("suspect", "incomplete_pairs")]


def test_what_an_emulator_measures_is_suspect(participant: Participant) -> None:
    measure(participant)
    DeviceModel.objects.update(kind=DeviceModel.Kind.EMULATOR)

    session_figures.summarise_sessions([MeasurementSession.objects.get().pk])

    assert states() == [("suspect", "emulator")]


def test_times_that_another_installation_sent_before_are_hidden(participant: Participant, join: Join) -> None:
    measure(participant, runs=abba())

    measure(join(), runs=abba(90_000))

    assert states() == [("valid", ""), ("quarantined", "identical_series")]
    figure = DeviceSpeedup.objects.get()
    assert (figure.installations, figure.speedup) == (1, pytest.approx(8.0, rel=0.01))


def test_a_copy_that_was_judged_before_its_original_is_hidden_all_the_same(
    participant: Participant, join: Join, no_worker: None, django_capture_on_commit_callbacks: Any
) -> None:
    """Several workers take new sessions in any order."""
    for who in (participant, join()):
        measure(who, runs=abba())
    original, copy = MeasurementSession.objects.order_by("pk").values_list("pk", flat=True)

    for session in (copy, original):
        with django_capture_on_commit_callbacks(execute=True):
            session_figures.summarise_session(session)
    session_figures.summarise_waiting()

    assert states() == [("valid", ""), ("quarantined", "identical_series")]
    assert not session_figures.waiting_sessions().exists()


def test_a_copy_that_is_invalid_or_was_released_is_not_judged_again_and_again(
    participant: Participant, join: Join, django_capture_on_commit_callbacks: Any
) -> None:
    def runs(ate_max: float) -> list[dict[str, Any]]:
        first, best, again, last = abba()
        return [first, best | {"ate_max": ate_max}, again | {"frame_us": varied(10_000, 2)}, last]

    measure(participant, runs=runs(0.012))
    measure(join(), runs=runs(0.9))  # with a copy that is invalid, and one that counts
    copied = Run.objects.get(reason="identical_series")
    with django_capture_on_commit_callbacks(execute=True):
        moderation.decide("release", "ada", "one device, sold to another", copied.session, copied)

    assert Run.objects.get(pk=copied.pk).reason == "released"
    assert not session_figures.waiting_sessions().exists()


def test_times_of_a_coarse_clock_may_come_twice(participant: Participant, join: Join) -> None:
    measure(participant)
    measure(join())

    assert states() == [("valid", ""), ("valid", "")]


def test_an_outlier_is_hidden_until_a_second_installation_agrees(
    join: Join, participant: Participant
) -> None:
    for best_us in (10_000, 10_100, 9_900):
        measure(join(), best_us=best_us)
    measure(participant, best_us=2_000)
    assert states()[-1] == ("quarantined", "outlier")
    alone = DeviceSpeedup.objects.get()
    assert (alone.installations, alone.speedup) == (3, pytest.approx(8.0, rel=0.01))

    measure(participant, best_us=2_050)  # the same installation does not count twice
    assert states()[-2:] == [("quarantined", "outlier")] * 2

    measure(join(), best_us=2_100)
    assert states() == [("valid", "")] * 6
    assert DeviceSpeedup.objects.get().installations == 5


def test_two_installations_cannot_outvote_each_other(participant: Participant, join: Join) -> None:
    measure(participant, best_us=10_000)
    measure(join(), best_us=3_000)

    assert states() == [("valid", "")] * 2


def test_a_speedup_far_from_what_the_front_predicts_is_suspect_until_others_confirm_it(
    participant: Participant, join: Join
) -> None:
    """The reference device predicts 8 times; at most four times that is plausible."""
    for best_us in (2_000, 2_040):
        measure(participant, best_us=best_us)
    assert states() == [("suspect", "implausible_speedup")] * 2

    measure(join(), best_us=2_100)

    assert states() == [("valid", "")] * 3


def test_without_a_plan_confirmation_lifts_the_reach_by_a_factor_of_two(front: Any, join: Join) -> None:
    """The reach is 32 times. A session beyond 64 stays suspect, and what it agrees with stays in."""
    for best_us in (1_300, 1_280, 1_220):
        measure(join(), best_us=best_us)

    assert states() == [("valid", "")] * 2 + [("suspect", "impossible_speedup")]


def test_no_confirmed_model_raises_what_is_possible_without_a_plan(front: Any, join: Join) -> None:
    """Each confirmed model raises the reach of the next one: by turns it would be without an end."""
    crowd(join, {"Pixel 8": [80 / 1.3] * 3, "Pixel 9": [80.0] * 3})

    assert states()[3:] == [("suspect", "impossible_speedup")] * 3


def test_a_hidden_sessions_runs_are_still_there_to_be_seen(participant: Participant, join: Join) -> None:
    for _ in range(3):
        measure(join())
    session = measure(participant, best_us=500)

    stored = Run.objects.filter(session__uuid=session["id"])
    assert [run.state for run in stored] == ["valid"] * len(session["runs"])
    assert SessionSummary.objects.get(session__uuid=session["id"]).log_ratio == pytest.approx(np.log(160))


def test_a_run_of_another_front_is_compared_with_nothing(
    participant: Participant, pack: dict[str, Any]
) -> None:
    measure(participant)
    version, _ = publish_content(front_document(pack, "second"))
    Run.objects.filter(configuration__name="best", repeat=1).update(
        configuration=version.configurations.get(name="accurate")
    )

    session_figures.summarise_session(MeasurementSession.objects.get().pk)

    assert [row.configuration.name for row in SessionSummary.objects.all()] == ["best"]
    assert SessionSummary.objects.get().pairs == 1


@pytest.mark.slow
def test_one_installation_cannot_move_the_crowds_figure(
    participant: Participant, join: Join, no_worker: None, settings: Any
) -> None:
    """60 sessions of one against one each of two others, of 25 days as it says, and faster by two fifths."""
    settings.FRONTRUNNER_SUBMISSIONS_PER_MINUTE = 0
    for limit in ("BYTES", "VALUES", "STORED_BYTES"):
        setattr(settings, f"FRONTRUNNER_{limit}_PER_DAY", 0)
    for _ in range(2):
        measure(join(), best_us=10_000)
    days = [f"2026-10-{1 + number % 25:02d}T10:00:00Z" for number in range(60)]
    for start in range(0, len(days), 10):
        send(participant, *(session_of(80 / 7, started_at=day) for day in days[start : start + 10]))

    session_figures.summarise_waiting()

    figure = DeviceSpeedup.objects.get()
    assert 8 <= figure.speedup < 8.2  # the mean over all sessions would be 11.3, over installations 9.0
    # They came on one day by the server's clock, whatever the client says: five of them count.
    assert (figure.installations, figure.sessions) == (3, 2 + 5)
    assert participant.get("/speedups").json()["summary"]["geometric_mean"] == pytest.approx(figure.speedup)


@pytest.mark.django_db
@pytest.mark.parametrize(("skipped", "reason"), [(60, ""), (40, "skipped_share")])
def test_a_session_of_three_that_leaves_out_frames_as_the_reference_does(
    pack: dict[str, Any], join: Join, client: Client, skipped: int, reason: str
) -> None:
    """Default, best, adaptive, adaptive, best, default: the headline stays that of best."""
    publish_content(adaptive_front_document(pack))
    times = {"default": 80_000, "best": 10_000, "adaptive": 5_000}
    left_out = [n >= FRAMES - 90 and (n * skipped) % 90 < skipped for n in range(FRAMES)]
    runs = in_balanced_order(times)
    for run in runs:
        if run["configuration"] == "adaptive":
            run["frame_us"] = [3 if one else 10_000 for one in left_out]
            run["tracked"] = [None if one else True for one in left_out]
            run["stages_us"] = None

    session = measure(join(), runs=runs)

    summaries = SessionSummary.objects.order_by("configuration__position")
    assert list(summaries.values_list("configuration__name", "reason")) == [
        ("best", ""),
        ("adaptive", reason),
    ]
    page = client.get(f"/sessions/{session['id']}/").content.decode()
    share = round(100 * sum(left_out) / 90)
    assert page.count(f"adapts, {share}\N{NARROW NO-BREAK SPACE}% of frames skipped") == 3  # answer, two runs
    page = client.get("/fronts/kfusion-test/").content.decode()
    assert "adapts, 60\N{NARROW NO-BREAK SPACE}% of frames skipped" in page
    best = DeviceSpeedup.objects.get(configuration__name="best")
    device = client.get(f"/devices/{best.device.slug}/").content.decode()
    assert "8.00" in device
    assert "adapts, 60\N{NARROW NO-BREAK SPACE}% of frames skipped" in device
