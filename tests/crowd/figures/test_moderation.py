"""What administrators decide holds, is logged, and survives a recomputation."""

from collections.abc import Callable

import pytest
from django.contrib.auth.models import Permission, User
from django.core.exceptions import ValidationError
from django.core.management import call_command
from django.test import Client
from django.urls import reverse

from crowd.results import moderation
from crowd.results.models import Decision, DeviceSpeedup, MeasurementSession, Run, SessionSummary
from tests.builders.documents import run_document
from tests.builders.measuring import measure
from tests.builders.participant import Participant

UNBALANCED = [
    run_document("default", 0, 0, 80_000),
    run_document("default", 1, 1, 80_000),
    run_document("best", 0, 2, 10_000),
    run_document("best", 1, 3, 10_000),
]


@pytest.fixture
def session(participant: Participant) -> MeasurementSession:
    measure(participant)
    return MeasurementSession.objects.get()


def state(session: MeasurementSession) -> tuple[str, str]:
    return SessionSummary.objects.values_list("state", "reason").get(session=session)


def test_a_quarantined_session_does_not_count_until_it_is_released(session: MeasurementSession) -> None:
    moderation.decide("quarantine", "ada", "a bench of the maker", session)
    assert state(session) == ("quarantined", "moderated")
    assert not DeviceSpeedup.objects.exists()

    moderation.decide("release", "ada", "it was a phone after all", session)
    assert state(session) == ("valid", "released")
    assert DeviceSpeedup.objects.get().speedup == pytest.approx(8.0)


def test_a_quarantined_run_leaves_the_others_of_its_session(session: MeasurementSession) -> None:
    run = session.runs.get(configuration__name="best", repeat=1)

    moderation.decide("quarantine", "ada", "the screen was on", session, run)

    run.refresh_from_db()
    assert (run.state, run.reason) == ("quarantined", "moderated")
    assert SessionSummary.objects.get().pairs == 1


def test_a_release_lifts_suspicion(participant: Participant) -> None:
    measure(participant, runs=UNBALANCED)
    session = MeasurementSession.objects.get()
    assert state(session) == ("suspect", "unbalanced_order")

    moderation.decide("release", "ada", "measured in the sun on purpose", session)

    assert state(session) == ("valid", "released")


def test_a_release_makes_nothing_accurate(participant: Participant) -> None:
    runs = [run_document("default", 0, 0, 80_000), run_document("best", 0, 1, 10_000, ate_max=0.2)]
    measure(participant, runs=runs)
    session = MeasurementSession.objects.get()

    moderation.decide("release", "ada", "it looks fine to me", session)

    assert state(session) == ("invalid", "ate_above_limit")


def test_a_recomputation_respects_decisions(session: MeasurementSession) -> None:
    moderation.decide("quarantine", "ada", "a bench of the maker", session)

    call_command("results", "recompute", "--all")

    assert state(session) == ("quarantined", "moderated")
    assert not DeviceSpeedup.objects.exists()


@pytest.mark.parametrize(("action", "reason"), [("hide", "because"), ("quarantine", " ")])
def test_a_decision_needs_an_action_and_a_reason(
    session: MeasurementSession, action: str, reason: str
) -> None:
    with pytest.raises(ValidationError):
        moderation.decide(action, "ada", reason, session)
    assert not Decision.objects.exists()


@pytest.fixture
def staff(client: Client, db: None) -> Callable[..., Client]:
    """Logs in somebody of the staff with these permissions."""

    def logged_in(*codenames: str) -> Client:
        user = User.objects.create_user("ada", password="correct horse battery", is_staff=True)
        user.user_permissions.add(*Permission.objects.filter(codename__in=codenames))
        client.force_login(user)
        return client

    return logged_in


def test_an_administrator_decides_on_the_rows_own_page(
    session: MeasurementSession, staff: Callable[..., Client]
) -> None:
    administrator = staff("view_measurementsession", "view_run", "add_decision")
    page = reverse("admin:results_measurementsession_change", args=[session.pk])
    assert "Quarantine" in administrator.get(page).content.decode()
    decide = reverse("admin:results_measurementsession_decide", args=[session.pk])

    answer = administrator.post(decide, {"action": "quarantine", "reason": "a bench"}, follow=True)

    assert "Logged: quarantine by ada" in answer.content.decode()
    assert "a bench" in answer.content.decode()
    assert state(session) == ("quarantined", "moderated")
    run = Run.objects.first()
    assert run is not None
    administrator.post(
        reverse("admin:results_run_decide", args=[run.pk]), {"action": "release", "reason": "but this one"}
    )
    assert Decision.objects.filter(run=run, action="release").exists()


def test_who_may_only_look_decides_nothing(session: MeasurementSession, staff: Callable[..., Client]) -> None:
    onlooker = staff("view_measurementsession")
    page = reverse("admin:results_measurementsession_change", args=[session.pk])
    assert "Quarantine" not in onlooker.get(page).content.decode()

    decide = reverse("admin:results_measurementsession_decide", args=[session.pk])

    assert onlooker.post(decide, {"action": "quarantine", "reason": "x"}).status_code == 403
    assert not Decision.objects.exists()


def test_a_decision_without_a_reason_is_refused_in_words(
    session: MeasurementSession, staff: Callable[..., Client]
) -> None:
    decide = reverse("admin:results_measurementsession_decide", args=[session.pk])

    administrator = staff("view_measurementsession", "add_decision")
    answer = administrator.post(decide, {"action": "quarantine"}, follow=True)

    assert "a decision needs one for the log" in answer.content.decode()
